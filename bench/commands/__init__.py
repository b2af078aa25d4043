"""Commands of ``olne-bench``, one file each.

How a command is called is in ``interface``, where nothing slow is imported, so that help is quick.
Commands that import nothing slow at all have one file only.
"""

#: Commands and their modules. A module's function has the last part of its name.
COMMANDS = {
    "check": "interface.check",
    "compare": "interface.compare",
    "confirm": "interface.confirm",
    "draws": "interface.draws",
    "estimate": "interface.estimate",
    "export": "interface.export",
    "film": "interface.film",
    "gate": "interface.gate",
    "import": "interface.import_tracks",
    "list": "list_all",
    "merge": "interface.merge",
    "new": "new",
    "record": "interface.record",
    "report": "interface.report",
    "run": "interface.run",
    "status": "interface.status",
    "submit": "interface.submit",
    "verify": "interface.verify",
}
