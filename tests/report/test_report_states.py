"""Charts of what varies: each with its worst state in words, and pictures of the view nearest to it."""

import re
from dataclasses import replace

import pytest

from lightwell.report import write_report

HOURS, DEGREES = "hour of the day", "turn of the environment, degrees"
PARTS = [
    {"name": "twilight", "times": 2, "points": 9, "relative_error": 0.128, "noise_floor": 0.05},
    {"name": "day", "times": 2, "points": 9, "relative_error": 0.143, "noise_floor": 0.05},
]
DOOR = {
    "name": "Door",
    "unit": "degrees",
    "poses": [{"value": at, "relative_error": e, "noise": 0.02} for at, e in ((0.0, 0.1), (45.0, 0.3), (90.0, 0.2))],
    "worst_pose": {"value": 45.0, "relative_error": 0.3, "noise": 0.02},
    "end_stops": [{"value": 0.0, "dark_points": 80, "leak": 0.004}],
}
LAMPS = {
    "error_of_each_lamp": {"desk": 0.2, "cove <b>": 0.4},
    "error_of_all_lamps": 0.25,
    "error_of_random_lamps": 0.3,
    "worst_random_lamps": {"relative_error": 0.5, "on": ["desk"]},
}


def page_of(folder, data, *states, **changes) -> str:
    """The page of a bake whose views show given states."""
    views = [replace(view, states=state) for view, state in zip(data.views, states)] or data.views
    page = write_report(folder, replace(data, views=views, **changes)).html.read_text("utf-8")
    return page.replace("\u202f", " ")


def figure_with(page: str, text: str) -> str:
    """The figure that has a text."""
    (found,) = [part for part in re.findall(r"<figure.*?</figure>", page, re.S) if text in part]
    return found


def test_a_day_has_its_worst_hour_and_parts_in_words_and_a_picture_near_it(tmp_path, data):
    sweep = [(5.0, 0.1, 0.02), (6.5, 0.4, 0.03), (12.0, 0.2, 0.02)]
    facts = {"times_of_day": PARTS}
    page = page_of(tmp_path, data, {HOURS: 13.5}, {HOURS: 7.25}, sweep=sweep, sweep_axis=HOURS, facts=facts)
    figure = figure_with(page, "over the hours of the day")
    assert "worst at 06:30 with 40.0 % (noise floor 3.00 %). Twilight 12.8 %, day 14.3 %." in figure
    assert "at 07:15, the picture nearest to 06:30" in figure and "<strong>plain</strong>" in figure
    assert figure.count('src="data:image') == 2
    # Ticks are times.
    assert ">06:00</text>" in figure and "times of day" not in page


def test_an_environment_has_its_worst_angle(tmp_path, data):
    sweep = [(0.0, 0.1, 0.02), (180.0, 0.4, 0.03), (360.0, 0.2, 0.02)]
    page = page_of(tmp_path, data, {DEGREES: 180.0}, sweep=sweep, sweep_axis=DEGREES)
    figure = figure_with(page, "over the turn of the environment")
    assert "worst at 180° with 40.0 %" in figure and "</strong>, at 180°." in figure


def test_a_day_beside_a_door_has_a_chart_of_its_own(tmp_path, data):
    """The sweep is that of the door then."""
    states = [{"at": hour, "lights": 4, "relative_error": e, "noise_floor": 0.02} for hour, e in ((6, 0.3), (12, 0.1))]
    facts = {"errors_over_lights": [{"axis": HOURS, "states": states}], "times_of_day": PARTS, "movers": [DOOR]}
    page = page_of(tmp_path, data, {"Door, degrees": 45.0}, sweep_axis="Door, degrees", facts=facts)
    assert "over the range of Door of what stands still, under one light; worst at 0.500° with 6.00 %" in page
    assert "worst at 06:00 with 30.0 %" in figure_with(page, "over the hours of the day")
    door = figure_with(page, "over the range of Door;")
    assert "worst at 45.0° with 30.0 % (noise floor 2.00 %); at 0° 0.400 % of the light" in door
    assert "</strong>, at 45.0°." in door and page.count("Twilight 12.8 %") == 1


@pytest.mark.parametrize("name", ["movers", "error of each lamp", "worst random lamps"])
def test_what_has_a_chart_is_not_in_the_table_of_facts(tmp_path, data, name):
    page = page_of(tmp_path, data, facts={"movers": [DOOR], **LAMPS, "size of the grid": 5})
    assert "size of the grid" in page and name not in page


def test_lamps_have_their_worst_states_in_words(tmp_path, data):
    figure = figure_with(page_of(tmp_path, data, facts=LAMPS), "Error of each lamp alone")
    for text in (
        "worst alone: cove &lt;b&gt; with 40.0 %",
        "all together 25.0 %",
        "random switches, worst 50.0 %, with desk on",
    ):
        assert text in figure
