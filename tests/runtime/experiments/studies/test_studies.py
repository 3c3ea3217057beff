"""Studies: trials in processes and in this one, their table, faults, errors, and studies that continue."""

import re
import subprocess
import sys
import warnings
from types import SimpleNamespace

import numpy as np
import pytest

import runtime
from runtime.experiments.studies import picture
from runtime.experiments.studies.journal import Journal
from runtime.host.errors import BAD_INPUT, OK, BadInput
from tests.checkout import ROOT
from tests.runtime.experiments.studies.conftest import KNEE
from tests.runtime.runs import KNEE_EXO
from tests.soaking import soaked

parquet = pytest.importorskip("pyarrow.parquet")

PEAK = {"function": "peak", "signal": "gain.y"}
NOISE = {"function": "rms", "signal": "noise.y"}
LENGTH = {"function": "peak", "signal": "length.y"}
TWO = {"peak": PEAK, "noise": NOISE}
STUDY = """\
diagram = "sine.py"
duration = 0.5
[grid]
gain = [1, 2, 3.5]
[objectives]
peak = { function = "peak", signal = "gain.y" }
"""


def study(**changes):
    given = {"diagram": "sine.py", "duration": 0.5, "grid": {"gain": [1, 2, 3.5]}, "objectives": {"peak": PEAK}}
    return runtime.study(**(given | changes))


def test_table_is_equal_bit_for_bit_in_processes_and_in_this_process(folder):
    more = {"seeds": [1, 2], "samples": 2, "sample": {"frequency": {"uniform": [0.9, 1.1]}}}
    more["objectives"] = TWO
    for name, workers in (("here", 0), ("two", 2)):
        study(output=folder / f"{name}.parquet", workers=workers, **more)
    assert (folder / "here.parquet").read_bytes() == (folder / "two.parquet").read_bytes()
    table = parquet.read_table(folder / "two.parquet").to_pydict()
    assert list(table) == ["trial", "gain", "frequency", "seed", "peak", "noise", "ticks", "fault", "error", "invalid"]
    assert table["gain"] == [1.0] * 4 + [2.0] * 4 + [3.5] * 4 and table["seed"] == [1, 2] * 6
    assert len(set(table["noise"])) == 2, "the noise depends on the seed alone"
    assert len(set(table["frequency"])) == 2, "every grid point has the same samples"
    assert not list(folder.glob("*.unfinished"))


def test_result_has_columns_and_runs_one_trial_again(folder):
    result = study(workers=0, seeds=[7], objectives={"peak": PEAK, "own": lambda trial: trial["gain.y"].max()})
    assert np.array_equal(result["peak"], result["own"]) and result["gain"].tolist() == [1, 2, 3.5]
    assert result.run(2)["gain.y"].max() == result["peak"][2]
    assert result.table().loc[1, "peak"] == result["peak"][1]
    with pytest.raises(KeyError, match="no column 'peek'.*peak"):
        result["peek"]


def test_picture_of_two_grid_parameters_is_a_heat_map_of_means_over_the_seeds(folder):
    result = study(workers=0, grid={"gain": [1.0, 2.0], "fails": [False, True]}, seeds=[1, 2], objectives=TWO)
    [peak, noise, *_] = picture.heat_maps(result.study, result.columns, ["peak", "noise"], ["gain", "fails"]).axes
    [mesh] = peak.collections
    np.testing.assert_allclose(mesh.get_array(), [[1.0, np.nan], [2.0, np.nan]])
    assert [text.get_text() for text in peak.texts] == ["1", "×", "2", "×"]
    assert [label.get_text() for label in noise.get_xticklabels()] == ["false", "true"]
    [mesh] = noise.collections
    assert mesh.get_array()[1, 0] == pytest.approx(result["noise"][4:6].mean(), rel=1e-12)


@pytest.mark.soak
def test_picture_of_other_parameters_has_a_point_per_trial_and_a_line_of_means(folder):
    sample = {"samples": 4, "sample": {"frequency": {"uniform": [0.9, 1.1]}}}
    result = study(workers=0, grid={"gain": [1, 2]}, objectives=TWO, **sample)
    [over_gain, over_frequency, *_] = picture.curves(
        result.study, result.columns, ["peak", "noise"], ["gain", "frequency"]
    ).axes
    points, line = over_gain.lines
    assert points.get_ydata().tolist() == result["peak"].tolist()
    assert line.get_xdata().tolist() == [1.0, 2.0]
    assert line.get_ydata() == pytest.approx([result["peak"][:4].mean(), result["peak"][4:].mean()], rel=1e-12)
    [points] = over_frequency.lines
    assert points.get_xdata().tolist() == result["frequency"].tolist()
    assert all(tick == int(tick) for tick in over_gain.get_xticks()), "the gains are integers"
    assert f"frequency={result['frequency'][0]:.6g}" in "".join(result.summary())
    assert "data:image/png" in result._repr_html_() and "8 trials, 0 faults" in result._repr_html_()
    with pytest.raises(BadInput, match="no objective 'peek': did you mean 'peak'"):
        result.plot("peek")


@pytest.mark.parametrize("others", [{}, {"frequency": [1.0, 2.0]}])
@pytest.mark.soak
def test_values_of_a_diverging_run_are_in_the_table_and_not_in_the_picture(others, folder):
    costs = {"rms": {"function": "rms", "signal": "gain.y"}, "own": lambda trial: -1e57 * trial["gain.y"].max()}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        result = study(workers=0, grid={"gain": [1.0, 2.0, 1e250], **others}, objectives=costs)
        result.plot().save("study.png")
    diverged = result["gain"] == 1e250
    assert (result["rms"][diverged] == np.inf).all() and (result["own"][diverged] < -1e306).all()
    assert (result["rms"][~diverged] < 2.0).all() and (folder / "study.png").stat().st_size


def test_samples_of_a_parameter_do_not_depend_on_the_others(folder):
    uniform, normal = {"frequency": {"uniform": [0.9, 1.1]}}, {"sine.phase": {"normal": [0.0, 0.1]}}
    one, both = (study(workers=0, grid={}, samples=3, sample=sample) for sample in (uniform, normal | uniform))
    assert one["frequency"].tolist() == both["frequency"].tolist()
    other = study(workers=0, grid={}, samples=3, sample=uniform, sample_seed=1)
    assert other["frequency"].tolist() != one["frequency"].tolist()


def test_interrupted_study_runs_only_the_missing_trials_and_gives_the_same_table(folder):
    more = {"objectives": {"count": "costs_of_test:counted", "once": "costs_of_test:raises_once"}, "workers": 1}
    path = folder / "study.parquet"
    with pytest.raises(BadInput, match=r"trial 2 \(gain=3.5\): UnknownName: .*no.such.*costs_of_test.py:\d+"):
        study(output=path, **more)
    assert not path.exists() and len((folder / "count").read_text()) == 3
    with open(folder / "study.parquet.unfinished", "a") as file:
        file.write('{"trial": 2, "ti')  # as of a process that was killed while it wrote
    study(output=path, **more)
    assert len((folder / "count").read_text()) == 4
    study(output=folder / "whole.parquet", **more)
    assert path.read_bytes() == (folder / "whole.parquet").read_bytes()


@pytest.mark.parametrize("content", ["text\ntext\n", "[]\n[]\n", '{"diagram": 1}\n{"trial": 0, "ti{"trial": 1}\n'])
def test_damaged_file_of_finished_trials_is_named(content, folder):
    (folder / "study.parquet.unfinished").write_text(content)
    with pytest.raises(BadInput, match=r"study.parquet.unfinished is damaged, or not the file of a study's finished"):
        study(output=folder / "study.parquet", workers=1)


def test_row_that_does_not_fit_on_the_disk_stops_the_study(folder, monkeypatch):
    journal = Journal(folder / "study.parquet.unfinished", {"diagram": "sine.py"})
    journal.close()
    monkeypatch.setattr(journal, "_file", SimpleNamespace(write=lambda line: len(line) - 1))
    with pytest.raises(OSError, match="No space left"):
        journal.write({"trial": 0})


def test_trial_runs_again_after_its_process_was_killed(folder):
    result = study(workers=2, objectives={"once": "costs_of_test:dies_once"})
    assert (folder / "died").exists() and result["once"].tolist() == [1.0, 1.0, 1.0]
    with pytest.raises(BadInput, match=r"trial 0 \(gain=1\): its process was killed or crashed"):
        study(workers=1, objectives={"never": "costs_of_test:dies"})


def test_faults_and_errors_are_columns_of_the_table(folder):
    result = study(workers=0, grid={"gain": [1.0, 0.25], "fails": [False, True]})
    assert np.isfinite(result["peak"]).tolist() == [True, False, False, False]
    assert "broken" in result["fault"][1] and result["error"][2] == "gain 0.25 is not allowed"
    with pytest.raises(BadInput, match=r"trial 0 \(gain=0.25\): gain 0.25 is not allowed"):
        study(workers=0, grid={"gain": [0.25, 1.0]}, output="study.parquet")
    assert not list(folder.glob("study*")), "the corrected study can have the same name"


def test_trial_in_which_a_knee_exceeds_its_stop_is_invalid_and_has_no_objectives(folder):
    (folder / "knee.py").write_text(KNEE)
    angle = {"function": "peak", "signal": "plant/walker.left_knee_angle"}
    result = study(
        diagram="knee.py", duration=3.0, grid={"torque": [0.0, 150.0]}, objectives={"angle": angle}, workers=0
    )
    assert np.isfinite(result["angle"]).tolist() == [True, False] and result["invalid"][0] is None
    assert result["invalid"][1].startswith("walker: the knee exceeds its stop by more than 5° after ")
    assert list(result.summary())[:2] == [
        "2 trials, 0 faults, 0 errors, 1 invalid",
        f"  first invalid: {result['invalid'][1]}",
    ]
    assert result.run(1).implausible == result["invalid"][1] and result.run(0).implausible is None


def test_usual_objectives_of_a_walking_wearer():
    given = {
        "work": {"function": "positive_work", "leg": "left"},
        "stride": {"function": "stride_time", "leg": "right"},
        "power": {"function": "mean_power", "joint": "left/knee", "after": 5.0},
        "tracking": {
            "function": "tracking_error",
            "signal": "left/knee.torque",
            "reference": "left/gate.y",
            "after": 5.0,
        },
        "mean": {"function": "mean", "signal": "left/gait_phase.phase", "after": 5.0},
        "muscles": {"function": "rms", "signal": "plant/walker.left_knee_torque", "after": 5.0},
    }
    result = runtime.study(KNEE_EXO, 12, given, grid={"assistance": [0.5]}, workers=0)
    trial = result.run(0)
    late = trial.time >= 5.0
    assert result["stride"][0] == pytest.approx(1.1, abs=0.01)
    power = (trial["left/knee.torque"] * trial["left/knee.velocity"])[late]
    assert result["power"][0] == pytest.approx(power.mean(), rel=1e-12)
    assert result["work"][0] == pytest.approx(1.1 * result["power"][0], rel=0.1), "the knee does little negative work"
    difference = (trial["left/knee.torque"] - trial["left/gate.y"])[late]
    assert result["tracking"][0] == pytest.approx(np.std(difference), rel=0.05) and result["tracking"][0] > 0.0
    muscles = trial["plant/walker.left_knee_torque"][late]
    assert result["muscles"][0] == pytest.approx(np.sqrt(np.mean(muscles**2)), rel=1e-12) and result["muscles"][0] > 5.0
    assert result["mean"][0] == pytest.approx(0.5, abs=0.05)


def test_study_whose_diagram_imports_another_source_now_is_another_study(limb):
    given = {"diagram": "limb.py", "grid": {}, "objectives": {"length": LENGTH}, "output": "limb.parquet"}
    limb(0.25)
    assert study(workers=1, **given)["length"].tolist() == [0.25]
    limb(0.5)
    with pytest.raises(BadInput, match="another study, which differs in module limb_of_test.shank: choose"):
        study(workers=1, **given)


@pytest.mark.parametrize("workers", [0, 1])
def test_study_imports_the_modules_of_its_own_diagram(workers, folder):
    for name, gain in (("a", 2.0), ("b", 5.0)):
        (folder / name).mkdir()
        (folder / name / "common_gain.py").write_text(f"GAIN = {gain}\n")
        text = (folder / "sine.py").read_text().replace("Gain(gain,", "Gain(gain * GAIN,")
        (folder / name / "sine.py").write_text(f"from common_gain import GAIN\n{text}")
    peaks = []
    for name in "ab":
        runtime.run(f"{name}/sine.py", 0.1)  # this process has imported the module of the other folder, too
        other = "a" if name == "b" else "b"
        peaks.append(study(diagram=f"{other}/sine.py", grid={"gain": [1]}, workers=workers)["peak"][0])
    assert peaks == pytest.approx([5.0, 2.0], rel=1e-3)


MISTAKES = {
    "a misspelt key": ("duration = 0.5", "duraton = 0.5", "unknown key 'duraton'.*duration"),
    "no duration": ("duration = 0.5", "", "missing key 'duration'"),
    "a negative duration": ("= 0.5", "= -1", "duration = -1: expected a number of seconds above 0"),
    "a single value": ("[1, 2, 3.5]", "1", "grid: gain = 1: expected a list"),
    "a misspelt objective": ('"peak"', '"peek"', "objective peak: .*'peek'.*peak"),
    "a misspelt argument": (
        "signal =",
        "signl =",
        "objective peak: its arguments are signl, those of peak are signal, after",
    ),
    "a missing module": ('"peak"', '"no_such:f"', "objective peak: cannot import no_such:f: No module"),
    "no objective": ("[objectives]\npeak", "[settings]\npeak", "objectives: none given"),
    "samples without a distribution": ("duration", "samples = 3\nduration", "samples = 3: expected .* 0 without"),
    "an unknown distribution": (
        "duration = 0.5",
        "duration = 0.5\nsamples = 1\nsample = { fails = { gauss = [0, 1] } }",
        "sample: fails = .*expected one of uniform",
    ),
    "a distribution with wrong limits": (
        "duration = 0.5",
        "duration = 0.5\nsamples = 1\nsample = { fails = { log_uniform = [0, 1] } }",
        "expected a lower and an upper limit, above 0",
    ),
    "a distribution without a finite limit": (
        "duration = 0.5",
        "duration = 0.5\nsamples = 1\nsample = { fails = { normal = [nan, 1] } }",
        "sample: fails = .*expected two numbers",
    ),
    "no number of samples": (
        "duration = 0.5",
        "duration = 0.5\nsample = { fails = { uniform = [0, 1] } }",
        "missing key 'samples': the number of values",
    ),
    "a seed twice": ("duration = 0.5", "duration = 0.5\nseeds = [1, 2, 1]", r"seeds: 1 is given twice"),
    "a seed that no column holds": ("duration", f"seeds = [{2**63}]\nduration", "seeds = .* at most 64 bits"),
    "an integer that no column holds": ("[1, 2, 3.5]", f"[1, {-(2**63) - 1}]", "grid: gain = .* at most 64 bits"),
    "no number": ("[1, 2, 3.5]", "[1, nan, nan]", "grid: gain = .*expected a list of numbers"),
    "a value twice": ("[1, 2, 3.5]", "[1, 2, 2]", r"grid: gain: 2 is given twice"),
    "a name in two tables": (
        "[objectives]",
        "[settings]\ngain = 2\n[objectives]",
        "'gain' is given in two tables, such as .settings. and .grid.: remove one",
    ),
    "two columns of one name": ("gain = [", "peak = [", "'peak' is the name of two columns"),
    "a missing diagram": ("sine.py", "sone.py", "cannot read the diagram sone.py: No such file"),
    "no TOML": ("[grid]", "[grid", "study.toml: "),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_mistake_in_a_study_is_named(mistake, folder, command_line):
    before, after, phrase = MISTAKES[mistake]
    assert before in STUDY
    (folder / "study.toml").write_text(STUDY.replace(before, after, 1))
    assert re.search(phrase, command_line.refused("study", "study.toml"))


@pytest.mark.soak
def test_command_writes_the_table_once_and_rejects_that_of_another_study(folder, command_line):
    (folder / "study.toml").write_text(STUDY + 'count = "costs_of_test:counted"\n')
    code, out, err = command_line("study", "study.toml", "--workers", "1")
    assert (code, err) == (OK, "")
    assert "3 trials, 0 faults, 0 errors, 0 invalid" in out and "highest" in out and "trial 2: gain=3.5" in out
    assert out.endswith("study.parquet\nstudy.png\n") and (folder / "study.png").read_bytes().startswith(b"\x89PNG")
    assert "expected the TOML file of a study" in command_line("study", "sine.py")[2]
    assert "create the folder out first" in command_line("study", "study.toml", "-o", "out/study.parquet")[2]
    assert "must end in .parquet" in command_line("study", "study.toml", "-o", "study.png")[2]
    assert command_line("study", "study.toml") == (OK, out, "") and len((folder / "count").read_text()) == 3
    (folder / "study.toml").write_text(STUDY.replace("3.5", "4"))
    code, out, err = command_line("study", "study.toml")
    assert (code, out) == (BAD_INPUT, "")
    assert "study.parquet has the results of another study, which differs in grid, objectives" in err
    with open("sine.py", "a") as file:
        file.write("\n")
    (folder / "study.toml").write_text(STUDY + 'count = "costs_of_test:counted"\n')
    assert "differs in the diagram file" in command_line("study", "study.toml")[2]


@pytest.mark.parametrize("sent", soaked(["", '{"file', '{"file": "robot.py"}', '{"file": "robot.py"}\n{"par'], but=[3]))
def test_a_worker_whose_study_was_interrupted_ends_without_a_word(sent):
    code = "import os; from runtime.experiments.studies.worker import main; main(1, 0)"
    worker = subprocess.run([sys.executable, "-c", code], input=sent, capture_output=True, text=True, cwd=ROOT)
    assert (worker.returncode, worker.stdout, worker.stderr) == (0, "", "")
