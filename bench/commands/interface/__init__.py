"""How each command is called: arguments, options and help, which import nothing slow."""
