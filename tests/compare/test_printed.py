"""What the papers print: typed in as it stands, and adding up to what they say of it."""

from __future__ import annotations

import itertools
import re
from pathlib import Path

import numpy as np
import pytest

from compare.printed import printed_paper
from frontend.simulate import load_scenario
from frontend.simulate.printed_view import PRINTED_A, PRINTED_IMAGE_SIZE
from graphslam.errors import BadConfig

TEXTS = {"SantanaLoc": "santana-localization.txt", "SantanaSLAM": "santana-slam.txt"}
PAPERS = tuple(TEXTS)


def plain(text: str) -> str:
    """Returns a text with single spaces, without the marks of italics."""
    return " ".join(re.sub(r"</?i>|\*", "", text).replace("\\%", "%").split())


@pytest.fixture
def texts(shared_data: Path) -> dict[str, str]:
    folder = shared_data.parent / "papers"
    if not folder.is_dir():
        pytest.skip(f"the papers' texts are not here: {folder}")
    return {key: plain((folder / name).read_text("utf-8")) for key, name in TEXTS.items()}


@pytest.mark.parametrize("paper", PAPERS)
def test_every_value_stands_in_the_words_quoted_and_they_in_the_paper(
    paper: str, texts: dict[str, str]
) -> None:
    for key, entry in printed_paper(paper).values.items():
        assert plain(entry.quote) in texts[paper], key
        assert f"{entry.value:g}" in re.findall(r"\d+(?:\.\d+)?", entry.quote), key


@pytest.mark.parametrize(
    ("paper", "table"), [("SantanaSLAM", "matching"), ("SantanaSLAM", "feature_map")]
)
def test_rows_of_printed_tables_stand_in_the_paper(
    paper: str, table: str, texts: dict[str, str]
) -> None:
    numbers = [float(n) for n in re.findall(r"\d+(?:\.\d+)?", texts[paper].replace(",", "."))]
    for row in printed_paper(paper).tables[table].rows:
        windows = (tuple(numbers[i : i + len(row)]) for i in range(len(numbers)))
        assert row in windows, row


@pytest.mark.parametrize("paper", PAPERS)
def test_captions_of_all_figures_stand_in_the_paper(paper: str, texts: dict[str, str]) -> None:
    figures = printed_paper(paper).figures
    numbers = {int(n) for n in re.findall(r"Fig\. (\d+)\.", texts[paper])}
    assert {int(n) for n in figures} == numbers
    for number, figure in figures.items():
        where = texts[paper].index(f"Fig. {number}.")
        assert plain(figure.caption) in texts[paper][where : where + 200], number


def test_the_homographys_cells_stand_in_the_paper(texts: dict[str, str]) -> None:
    for row in printed_paper("SantanaLoc").tables["homography"].rows:
        cells = " & ".join(f"{cell:.4f}" if cell != 1 else "1" for cell in row)
        assert cells in texts["SantanaLoc"]


def test_the_matching_table_adds_up_to_136_of_145() -> None:
    table = printed_paper("SantanaSLAM").tables["matching"]
    seen, right, wrong = (
        np.array(table.column(name)) for name in ("identifications", "correct", "incorrect")
    )
    np.testing.assert_array_equal(seen, right + wrong)
    assert (right.sum(), seen.sum()) == (136, 145)
    np.testing.assert_allclose(table.column("hit_rate_percent"), 100 * right / seen, atol=0.06)


def test_the_corrected_feature_map_is_off_by_26_mm_and_2_1_degrees() -> None:
    table = printed_paper("SantanaSLAM").tables["feature_map"]
    columns = {name: np.array(table.column(name)) for name in table.columns}
    rho = columns["corrected_rho_m"] - columns["actual_rho_m"]
    alpha = columns["corrected_alpha_deg"] - columns["actual_alpha_deg"]
    assert np.sqrt(np.mean(rho**2)) == pytest.approx(0.026, abs=5e-4)
    assert np.sqrt(np.mean(alpha**2)) == pytest.approx(2.1, abs=0.05)


def test_no_rigid_motion_takes_the_calculated_feature_map_to_the_corrected() -> None:
    """Whatever its start pose, and whichever of its two names each calculated line goes by."""
    table = printed_paper("SantanaSLAM").tables["feature_map"]
    rho, corrected = (np.array(table.column(f"{s}_rho_m")) for s in ("calculated", "corrected"))
    alpha = np.radians(table.column("corrected_alpha_deg"))
    normals = np.column_stack([np.cos(alpha), np.sin(alpha)])
    worst = []
    for names in itertools.product((1.0, -1.0), repeat=6):
        off = corrected - np.array(names) * rho
        shift = np.linalg.lstsq(normals, off, rcond=None)[0]
        worst.append(np.abs(normals @ shift - off).max())
    assert min(worst) > 0.2


def test_shares_of_steps_add_up() -> None:
    loc, slam = printed_paper("SantanaLoc"), printed_paper("SantanaSLAM")
    one_or_two = loc.value("experiment_2_steps_one_line") + loc.value(
        "experiment_2_steps_two_lines"
    )
    assert one_or_two == loc.value("experiment_2_steps_with_lines")
    assert slam.value("seeing_steps_one_line") + slam.value("seeing_steps_two_lines") == 100


def test_what_is_simulated_is_what_is_printed() -> None:
    loc = printed_paper("SantanaLoc")
    assert loc.tables["homography"].rows == PRINTED_A
    assert (loc.value("image_width"), loc.value("image_height")) == PRINTED_IMAGE_SIZE
    for number in (1, 2):
        scenario = load_scenario(f"santana-loc-{number}")
        path = [(abs(m.forward or 0.0), abs(m.turn_deg or 0.0)) for m in scenario.path]
        assert path == [row[1:] for row in loc.tables[f"experiment_{number}_path"].rows]
        assert 1e3 / scenario.rate == pytest.approx(loc.value("time_total"))
    slam, scenario = printed_paper("SantanaSLAM"), load_scenario("santana-slam")
    rows = [(g.first + k * g.spacings[0], g.alpha_deg) for g in scenario.grids for k in range(3)]
    actual = zip(
        *(slam.tables["feature_map"].column(f"actual_{c}") for c in ("rho_m", "alpha_deg")),
        strict=True,
    )
    np.testing.assert_allclose(rows, list(actual))


def test_what_is_not_printed_is_an_error_that_names_the_nearest() -> None:
    with pytest.raises(BadConfig, match="did you mean 'SantanaLoc'"):
        printed_paper("santanaLoc")
    with pytest.raises(BadConfig, match="did you mean 'time_total'"):
        printed_paper("SantanaLoc").value("times_total")
    with pytest.raises(BadConfig, match="did you mean 'correct'"):
        printed_paper("SantanaSLAM").tables["matching"].column("corect")


def test_atalis_angle_is_the_direction_of_its_position_and_the_filter_copies_it() -> None:
    """Table II: an erratum. What it calls the rotation angle of the robot is atan2(y, x)."""
    table = printed_paper("Atali").tables["positions"]
    x, y, alpha = (
        np.array(table.column(f"imaging {name}")) for name in ("x (m)", "y (m)", "alpha")
    )
    assert np.abs(np.arctan2(y, x) - alpha).max() < 0.0025
    # R has no noise of the angle, so that the filter's is the camera's to the last digit
    assert table.column("EKF alpha") == table.column("imaging alpha")
