"""The report page: one self-contained HTML file that needs no network.

``data`` and ``scenes`` collect what it shows. ``template.html``, ``shared.html``, ``page.css`` and
``script/`` define how it looks. ``render`` puts them together.
"""
