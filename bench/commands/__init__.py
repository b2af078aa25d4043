"""Commands of ``olne-bench``, one file each."""

#: Commands and their modules. A module's function has the module's name.
COMMANDS = {
    "check": "check",
    "compare": "compare",
    "confirm": "confirm",
    "draws": "draws",
    "drive": "drive",
    "estimate": "estimate",
    "export": "export",
    "gate": "gate",
    "import": "import_tracks",
    "list": "list_all",
    "merge": "merge",
    "new": "new",
    "online": "online",
    "record": "record",
    "report": "report",
    "run": "run",
    "status": "status",
    "submit": "submit",
    "verify": "verify",
}
