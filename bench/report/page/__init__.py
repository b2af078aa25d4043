"""The report page: one self-contained HTML file that needs no network.

``data`` and ``scenes`` say what is on it, ``template.html``, ``shared.html``, ``page.css`` and
``script/`` how it looks, and ``render`` puts them together.
"""
