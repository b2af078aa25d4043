"""Bad input gives one clear line and exit code 2, quickly and whatever its size."""

import os
import resource
import time

import pytest

from olne_bench.bench.commands.cli import main

GOOD = """
name = "tiny"
scenarios = ["two_player"]
sensors = ["full"]
sigmas = [0.0, 0.1]
seeds = 3
estimators = ["uniform"]
"""

LONG = "n" * 300
DIGITS = "9" * 5000

SEEDS, NAME, GAME, SENSOR, WHO = "seeds = 3", '"tiny"', '"two_player"', '"full"', '"uniform"'


def game(name: str, options: str) -> str:
    return f'{{name = "{name}", options = {{{options}}}}}'


def crowd(number: object) -> str:
    return game("random", f"num_players = {number}")


TOO_MANY = f"{', '.join(f'0.{k:04}' for k in range(1, 9))}]\nseeds = {10**8}"
UNPRINTABLE = "it cannot contain control characters or line breaks"
OF_ROLL = "{name = 'correlated', parameters = {correlation = 0.3, components = ['roll']}}"
#: What to replace in GOOD, by what, and a part of the message.
SUITES = {
    "too many seeds": (SEEDS, f"seeds = {10**12}", "seeds: Input should be less than"),
    "too many trials": (f"0.1]\n{SEEDS}", TOO_MANY, "800000001 trials, at most 100000000"),
    "5,000 digits": (SEEDS, f"seeds = {DIGITS}", "not valid TOML: Exceeds the limit"),
    "5,000 digits in hexadecimal": (SEEDS, f"seeds = 0x{DIGITS}", "seeds: Input should"),
    "5,000 digits in options": (GAME, crowd(f"0x{DIGITS}"), "'num_players' is a number of more th"),
    "5,000 lists": (SEEDS, f"x = {'[' * 5000}{']' * 5000}", "not valid TOML"),
    "5,000 tables": (f"[{WHO}]", f"[{WHO}]\n[{'.'.join(['a'] * 5000)}]\nb = 1", "unknown key 'a'"),
    "nested options": (GAME, crowd("[[[[[[[[1]]]]]]]]"), "is nested deeper than"),
    "a date in parameters": (
        WHO,
        '{name = "uniform", parameters = {a = 2020-01-01}}',
        "'a' must be a number, text, list or table, got datetime.date(2020, 1, 1)",
    ),
    "too many players": (GAME, crowd(10**9), "num_players must be"),
    "more players than a road holds": (
        GAME,
        game("merge", "num_players = [2, 7]"),
        "scenario 'merge' holds 2 to 6 players, got num_players = 7",
    ),
    "an unknown temperament": (
        GAME,
        game("merge", 'weights = "temperaments", shares = {hasty = 1.0}'),
        "unknown temperament 'hasty'; known are: aggressive, normal, cautious",
    ),
    "shares of less than all": (
        GAME,
        game("merge", 'weights = "temperaments", shares = {normal = 0.7}'),
        "shares of temperaments must sum to 1, got 0.7",
    ),
    "too many iterations": (SEEDS, f"{SEEDS}\nroot_iterations = {2**31}", "root_iter"),
    "too many trajectories": (SEEDS, f"{SEEDS}\ntrajectories = {10**9}", "trajectories"),
    "an endless limit": (SEEDS, f"{SEEDS}\ntime_limit = 1e300", "time_limit: Input should"),
    "infinity": (SEEDS, f"{SEEDS}\ntime_limit = inf", "time_limit: Input should"),
    "huge noise": ("0.1]", "1e300]", "sigmas.1: Input should be less than"),
    "a long name": (NAME, f'"{LONG}"', "name: String should have at most 120 characters"),
    "NUL": (NAME, '"ti\\u0000ny"', f"name: {UNPRINTABLE}"),
    "a line break": (NAME, '"ti\\nny"', f"name: {UNPRINTABLE}"),
    "an empty salt": (SEEDS, f'{SEEDS}\nsalt = "\\t"', "salt: a text that is not empty"),
    "a line break in a label": (
        WHO,
        '{name = "uniform", label = "a\\nb"}',
        f"estimators.0.label: {UNPRINTABLE}",
    ),
    "a long sensor label": (SENSOR, f'{{name = "full", label = "{LONG}"}}', "sensors.0.label"),
    "an escape in an option": (GAME, crowd('"\\u001b[2J"'), "control characters"),
    "NUL in a plugin": (WHO, '"a\\u0000b.py"', f"estimators.0.name: {UNPRINTABLE}"),
    "a long plugin": (WHO, f'"{LONG}.py"', "no estimator file "),
    "the same twice": (SENSOR, '"full", "full"', "sensor 'full' is listed twice"),
    "the same label twice": (
        SENSOR,
        '"full", {label = "full", stack = ["partial"]}',
        "sensor 'full' is listed twice",
    ),
    "a metric twice": (
        SEEDS,
        f'{SEEDS}\nmetrics = ["cosine_error", "cosine_error"]',
        "metric 'cosine_error' is listed twice",
    ),
    "neither name nor stack": (SENSOR, "{label = 'a'}", "a sensor has a name, or a stack"),
    "both name and stack": (SENSOR, "{name = 'full', stack = ['full']}", "not both"),
    "an empty stack": (SENSOR, "{label = 'a', stack = []}", "sensors.0.layers: Tuple should"),
    "what is learnt": (GAME, "{name = 'random', family = false}", "unknown key 'scena"),
    "a sensor that does not fit": (
        SENSOR,
        OF_ROLL,
        "does not fit scenario 'two_player': correlated noise: no component 'roll' is seen",
    ),
    "two kinds of noise": (
        SENSOR,
        "{label = 'both', stack = ['correlated', 'correlated']}",
        "sensor 'both' does not fit",
    ),
    "an unknown limit": (
        SEEDS,
        f"{SEEDS}\ngate = {{uniform = {{speed = 1}}}}",
        "unknown limit 'speed'; the suite has: cosine_error, ",
    ),
    "too many entries": (SENSOR, ", ".join([SENSOR] * 1001), "sensors: Tuple should have at"),
}


@pytest.fixture
def suite(tmp_path):
    path = tmp_path / "suite.toml"
    path.write_text(GOOD)
    return path


def refusal(capsys, *arguments) -> str:
    """The message on bad input: one line within seconds, in bounded memory."""
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    started, worked = time.monotonic(), time.process_time()
    with pytest.raises(SystemExit) as ended:
        main([str(argument) for argument in arguments])
    # On a busy machine, processor time is a better measure than wall-clock time.
    worked, seconds = time.process_time() - worked, time.monotonic() - started
    grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before  # [KiB], on Linux
    said, errors = capsys.readouterr()
    assert ended.value.code == 2, said + errors
    assert said == ""
    assert errors.count("\n") == 1, errors
    assert errors.startswith("olne-bench: error: ")
    assert len(errors) < 6000
    assert worked < 5
    assert seconds < 30
    assert grown < 200_000
    return errors


@pytest.mark.parametrize("case", SUITES)
def test_a_bad_suite_is_one_line(capsys, tmp_path, suite, case):
    old, new, expected = SUITES[case]
    assert old in GOOD
    suite.write_text(GOOD.replace(old, new, 1))
    assert expected in refusal(capsys, "run", suite, "--out", tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("option", "value", "expected"),
    [
        ("--out", "", "'' names no file or folder"),
        ("--out", "a\0b", "a name cannot contain control characters or line breaks"),
        ("--out", "a\nb", "a name cannot contain control characters or line breaks"),
        ("--out", LONG, "a name has at most 200 bytes"),
        ("--plugin", "", "'' names no file or folder"),
        ("--plugin", "a\0b.py", "control characters"),
        ("--plugin", f"{LONG}.py", "a name has at most 200 bytes"),
        ("--plugin", "absent.py", "absent.py"),
        ("--jobs", 10**8, "100000000 is not in the range 1<=x<=1024"),
        ("--jobs", DIGITS, "is not a valid integer"),
        ("--seeds", 10**12, "is not in the range"),
        ("--sigma", "nan", "has no sigma nan; it has: 0.0, 0.1"),
        ("--scenario", LONG, "has no scenario 'nnn"),
        ("--sensor", "a\nb", "has no sensor 'a\\nb'; it has: full"),
        ("--salt", "", "--salt '': a salt is 'fresh', or a text of 1 to 120 characters"),
        ("--salt", LONG, "a salt is 'fresh'"),
        ("--salt", "a\nb", "a salt is 'fresh'"),
    ],
)
def test_a_bad_option_of_run_is_one_line(
    capsys, tmp_path, suite, monkeypatch, option, value, expected
):
    monkeypatch.chdir(tmp_path)
    given = {"--out": "out"} | {option: value}
    words = [word for pair in given.items() for word in pair]
    assert expected in refusal(capsys, "run", suite, *words)
    assert {path.name for path in tmp_path.iterdir()} <= {"suite.toml"}


@pytest.mark.parametrize("command", ["status", "report", "gate", "confirm"])
@pytest.mark.parametrize("folder", ["", "a\0b", LONG, "absent"])
def test_a_bad_folder_is_one_line(capsys, tmp_path, monkeypatch, command, folder):
    monkeypatch.chdir(tmp_path)
    refusal(capsys, command, folder)


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("a\0b.toml", "unknown suite"),
        (f"{LONG}.toml", "unknown suite"),
        ("folder.toml", "unknown suite"),
        ("pipe.toml", "unknown suite"),
        ("large.toml", "larger than 200000 bytes"),
        ("latin.toml", "not valid TOML: 'utf-8' codec"),
        ("secret.toml", "cannot be read: Permission denied"),
    ],
)
def test_a_bad_file_is_one_line(capsys, tmp_path, monkeypatch, name, expected):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder.toml").mkdir()
    os.mkfifo("pipe.toml")
    with (tmp_path / "large.toml").open("wb") as file:
        file.truncate(100 * 2**20)
    (tmp_path / "latin.toml").write_bytes("name = 'ü'".encode("latin1"))
    (tmp_path / "secret.toml").write_text(GOOD)
    if name == "secret.toml":
        (tmp_path / name).chmod(0)
        if os.access(name, os.R_OK):  # root may read it anyway
            monkeypatch.setattr("pathlib.Path.open", _refuse)
    assert expected in refusal(capsys, "run", name, "--out", "out")


def _refuse(*_arguments, **_options):
    raise PermissionError(13, "Permission denied")
