"""The verdict of a bake in words."""

from lightwell.report.verdict import verdict

GOOD = {"psnr_db": 37.0, "flip": 0.05, "mottle": 0.03, "leak": 0.004}


def test_a_good_bake_is_one_word():
    found = verdict(GOOD, ["a", "b", "c"], [37.0, 36.5, 37.5])
    assert (found.level, found.text) == ("good", "good")


def test_the_worst_figure_decides_and_is_put_in_words():
    found = verdict({**GOOD, "leak": 0.05, "mottle": 0.06})
    assert found.level == "poor" and found.text == "poor: dark places glow; --quality best would help"
    assert verdict({**GOOD, "mottle": 0.06}).text.startswith("fair: smooth surfaces show blotches")


def test_a_view_that_is_much_worse_is_named_even_where_the_rest_is_good():
    found = verdict(GOOD, ["hall", "far bedroom", "bath"], [38.0, 34.0, 37.0], cure="--budget 20m")
    assert found.text == "good; the view 'far bedroom' is 3 dB worse than the others; --budget 20m would help"
    assert verdict(GOOD, ["hall", "bath"], [38.0, None]).text == "good"


def test_without_indirect_light_nothing_is_judged():
    assert verdict({"psnr_db": None}).text.startswith("not judged")


def test_what_the_noise_hides_is_not_good_unless_its_bound_is():
    hidden = {**GOOD, "mottle": None}
    found = verdict(hidden, bounds={"mottle": 0.2})
    assert found.level == "fair" and found.text.startswith("good in what can be measured; mottle not measurable")
    assert verdict(hidden, bounds={"mottle": 0.04}).text == "good"
    # A lower bound of 30 dB does not say that the picture is bad, and one of 37 dB says that it is good.
    assert "PSNR not measurable" in verdict({**GOOD, "psnr_db": 30.0}, bounds={"psnr_db": 30.0}).text
    assert verdict({**GOOD, "psnr_db": 37.0}, bounds={"psnr_db": 37.0}).text == "good"
    assert verdict({**hidden, "leak": 0.05}, bounds={"mottle": 0.2}).level == "poor"


def test_without_a_cure_none_is_named():
    assert verdict({**GOOD, "psnr_db": 32.0}, cure="").text.endswith("from the reference")


def test_faults_of_the_indirect_light_that_direct_light_outshines_are_not_said_to_be_seen():
    """A room full of lamps: its few places without direct light have blotches, and the pictures look alike."""
    outshone = {"psnr_db": 33.9, "flip": 0.002, "mottle": 0.105, "leak": 0.004}
    found = verdict(outshone)
    assert found.level == "fair" and found.text.startswith("fair: the indirect light alone differs from the reference")
    assert "blotches" in verdict({**outshone, "flip": 0.02}).text
    assert verdict({**outshone, "leak": 0.05}).text.startswith("poor: dark places glow")
    assert verdict({**GOOD, "flip": 0.002}).text == "good"
