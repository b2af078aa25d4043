import pytest

from olne_bench.envs.drive.setting import AVERAGE, ENCOUNTER, LEARNT, STOCK, DriveSetting


def test_an_encounter_is_shorter_than_a_drive_through_traffic() -> None:
    assert DriveSetting("merge").steps == 100
    assert DriveSetting("merge", scene=ENCOUNTER, ego=AVERAGE).steps == 40


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"scene": "crash"}, "unknown scene 'crash'; known are: traffic, encounter"),
        ({"ego": "famous"}, "unknown ego 'famous'; known are: known, average, learnt"),
        ({"scene": ENCOUNTER}, "needs ego = 'average' or 'learnt'"),
        ({"traffic": STOCK, "ego": LEARNT}, "need traffic = 'nash'"),
        ({"traffic": STOCK, "scene": ENCOUNTER, "ego": AVERAGE}, "need traffic = 'nash'"),
    ],
)
def test_what_does_not_go_together_is_refused(options: dict[str, str], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        DriveSetting("merge", **options)
