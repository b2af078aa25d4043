"""The report page: one self-contained HTML file that needs no network.

``data`` and ``scenes`` say what is on it, ``template.html``, ``page.css`` and ``page.js`` how it
looks, and ``render`` puts them together.
"""
