"""How each command is called: arguments, options and help, which import nothing slow.

What a command does is in ``bench.commands``, in a module and a function of its name.
"""

from olne_bench.bench.commands.interface import plugins, recordings, studies

#: Commands by name.
COMMANDS = {
    str(one.name): one
    for one in (
        *(plugins.check, plugins.list_all, plugins.new),
        *(recordings.estimate, recordings.export, recordings.film),
        *(recordings.groups, recordings.import_tracks, recordings.people, recordings.predict),
        recordings.record,
        *(studies.compare, studies.confirm, studies.draws, studies.gate, studies.merge),
        *(studies.report, studies.run, studies.status, studies.submit, studies.verify),
    )
}
