"""The rules of a study online, kept beside its store: rows of other rules are never mixed."""

from dataclasses import asdict, fields
from pathlib import Path

import msgspec

from olne_bench.bench.plan.motion import OnlineRules
from olne_bench.bench.plan.suite import Suite
from olne_bench.errors import UserError
from olne_bench.files import whole_file

#: File of a study's rules.
SETTINGS = "online.json"


def keep_rules(out: Path, suite: Suite, rules: OnlineRules, *, begun: bool) -> None:
    """Note the rules of a new study; refuse others in an old one.

    Args:
        out: folder of the study.
        suite: what it runs.
        rules: its rules now.
        begun: whether the study has been begun before.

    Raises:
        UserError: if a rule differs, as rows of both would be mixed.
    """
    path, kept = out / SETTINGS, asdict(rules)
    if begun and path.exists():
        former = asdict(read_rules(out))
        for name, value in asdict(rules).items():
            old = former[name]
            if name == "fit_every" and None in (old, value):  # fits may come later
                kept[name] = old or value
            elif old != value:
                raise UserError(
                    f"{out} holds a study whose {name} is {_told(old)}, and here it is "
                    f"{_told(value)}; rows of both would be mixed: use another --out"
                )
    settings = {"suite": suite.model_dump(mode="json")} | kept
    with whole_file(path) as new:
        new.write_bytes(msgspec.json.format(msgspec.json.encode(settings), indent=1))


def read_rules(folder: Path) -> OnlineRules:
    """The rules of the study in a folder.

    Raises:
        UserError: if its file is missing or damaged.
    """
    path = folder / SETTINGS
    try:
        settings = msgspec.json.decode(path.read_bytes(), type=dict)
        names = [field.name for field in fields(OnlineRules)]
        return msgspec.convert({name: settings.get(name) for name in names}, OnlineRules)
    except (OSError, msgspec.MsgspecError) as error:
        raise UserError(f"cannot read the rules of the study in {path}: {error}") from error


def _told(value: float | None) -> str:
    return "the default" if value is None else f"{value:g}"
