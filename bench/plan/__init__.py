"""What is to be run: suites, their trials, and the versions of the code that they depend on."""
