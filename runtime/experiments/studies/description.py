"""Description of a study: its keys in a TOML file or a call, their checks, and the trials that follow from them."""

from __future__ import annotations

import itertools
import math
import os
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from cext.user_files import read_small
from graph.sha256 import sha256
from runtime.experiments.studies import modules, objectives
from runtime.host.errors import BadInput
from runtime.host.suggestions import suggestion
from runtime.robot.loading.overrides import derive_seed
from runtime.robot.loading.recorded_signals import PLANT

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

TABLES = ("settings", "grid", "sample", "objectives")
KEYS = ("diagram", "duration", "rate", "seeds", "samples", "sample_seed", "subject", *TABLES)
RESULTS = ("trial", "ticks", "fault", "error", "invalid")  # columns of every table
DISTRIBUTIONS: dict[str, Callable[[np.random.Generator, int, Any, Any], np.ndarray]] = {
    "uniform": lambda source, count, low, high: source.uniform(low, high, count),
    "log_uniform": lambda source, count, low, high: np.exp(source.uniform(math.log(low), math.log(high), count)),
    "normal": lambda source, count, mean, deviation: source.normal(mean, deviation, count),
}


@dataclass(frozen=True)
class Study:
    """Description of a study. The fields are the keys of its TOML file.

    diagram : path of a diagram file; in a call without processes also a function that builds a Diagram
    duration : s, of each run
    rate : Hz instead of the diagram's own
    seeds : integers; every combination runs once with each of them as the seed of its noise sources
    samples : number of values drawn for each parameter of `sample`
    sample_seed : integer from which the samples are drawn
    subject : path of a subject file, whose limits no trial exceeds; None without one
    settings : {name: value} of every run
    grid : {name: [values]}, whose combinations are run
    sample : {name: {distribution: [two numbers]}}
    objectives : {name: function, or {"function": function, argument: value}}
    """

    diagram: Any
    duration: float
    rate: float | None = None
    seeds: list[int] = field(default_factory=list)
    samples: int = 0
    sample_seed: int = 0
    subject: str | None = None
    settings: dict[str, Any] = field(default_factory=dict)
    grid: dict[str, list[Any]] = field(default_factory=dict)
    sample: dict[str, dict[str, list[float]]] = field(default_factory=dict)
    objectives: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not (_is_number(self.duration) and 0.0 < self.duration < math.inf):
            raise BadInput(f"duration = {self.duration!r}: expected a number of seconds above 0")
        for name, values in self.grid.items():
            if not isinstance(values, list) or not values or not all(map(_is_value, values)):
                raise BadInput(
                    f"grid: {name} = {values!r}: expected a list of numbers (integers of at most 64 bits), texts or "
                    "booleans"
                )
            _check_distinct(f"grid: {name}", values)
        if not isinstance(self.seeds, list) or not all(type(seed) is int and _fits(seed) for seed in self.seeds):
            raise BadInput(f"seeds = {self.seeds!r}: expected a list of integers of at most 64 bits, as in [1, 2, 3]")
        _check_distinct("seeds", self.seeds)
        if self.sample and self.samples == 0:
            raise BadInput("missing key 'samples': the number of values of [sample], as in samples = 50")
        if type(self.samples) is not int or self.samples < 0 or (self.samples > 0) != bool(self.sample):
            raise BadInput(
                f"samples = {self.samples!r}: expected a whole number, 1 or more with a [sample] table and 0 without"
            )
        for name in self.sample:
            _check_distribution(name, self.sample[name])
        if not isinstance(self.objectives, Mapping):
            raise BadInput(f'objectives = {self.objectives!r}: expected named functions, as in {{"range": function}}')
        if not self.objectives:
            raise BadInput('objectives: none given: add one, as in work = {function = "positive_work", leg = "left"}')
        for name, given in self.objectives.items():
            objectives.load(name, given)
        for name in self.parameters:
            if self.parameters.count(name) + (name in self.settings) > 1:
                raise BadInput(f"{name!r} is given in two tables, such as [settings] and [grid]: remove one")
        names = [*RESULTS, *self.settings, *self.parameters, *self.objectives]
        for name in names:
            if names.count(name) > 1:
                raise BadInput(f"{name!r} is the name of two columns of the table: rename the objective or the setting")

    @property
    def parameters(self) -> list[str]:
        """Names of the parameters in which trials differ, in the order of the table's columns."""
        return [*self.grid, *self.sample, *(["seed"] if self.seeds else [])]

    def trials(self) -> Iterator[dict[str, Any]]:
        """Yield {parameter: value} of each trial, the last parameter fastest. Every grid point has the same samples."""
        drawn = {name: _draw(name, self.sample[name], self.samples, self.sample_seed) for name in self.sample}
        samples = [dict(zip(drawn, values)) for values in zip(*drawn.values())] if drawn else [{}]
        seeds = [{"seed": seed} for seed in self.seeds] or [{}]
        points = (dict(zip(self.grid, values)) for values in itertools.product(*self.grid.values()))
        for point, sample, seed in itertools.product(points, samples, seeds):
            yield point | sample | seed

    def run_of(self, parameters: Mapping[str, Any]) -> dict[str, Any]:
        """Return the arguments of runtime.run for a trial. parameters : one of `trials`"""
        varied = dict(parameters)
        seed = varied.pop("seed") if self.seeds else None
        return {
            "duration": self.duration,
            "settings": {**self.settings, **varied},
            "seed": seed,
            "rate": self.rate,
            "subject": self.subject,
            "plant_signals": self.plant_signals(),
        }

    def plant_signals(self) -> list[str]:
        """Return the signals of the plant that arguments of objectives name, as in signal = "plant/walker.speed"."""
        given = [argument for one in self.objectives.values() if isinstance(one, dict) for argument in one.values()]
        paths = [argument for argument in given if isinstance(argument, str) and argument.startswith(PLANT)]
        return list(dict.fromkeys(path.removeprefix(PLANT) for path in paths))

    def content(self) -> dict[str, Any]:
        """Return the content of a TOML file with this description. The diagram is a path."""
        return {**{key: getattr(self, key) for key in KEYS}, "diagram": os.fspath(self.diagram)}

    def identity(self) -> dict[str, Any]:
        """Return the description as plain data. Raises BadInput.

        It has the SHA-256 of the diagram file and of the modules that it and the objectives import.
        """
        functions = [given.get("function") if isinstance(given, dict) else given for given in self.objectives.values()]
        if not isinstance(self.diagram, (str, os.PathLike)) or any(callable(function) for function in functions):
            raise BadInput(
                "processes and tables need names: save the diagram and the objectives as files and pass "
                '"diagrams/knee.py" and "module:function", or pass workers=0 and no output'
            )
        try:
            source = sha256(Path(self.diagram).read_bytes()).hexdigest()
        except OSError as error:
            raise BadInput(f"cannot read the diagram {self.diagram}: {error.strerror or error}") from None
        content = self.content()
        person = content.pop("subject")
        if person is not None:
            from runtime.robot.loading.subject import read

            content["subject_sha256"] = read(person).sha256
        return {
            **content,
            "source_sha256": source,
            **{f"module {name}": digest for name, digest in self.sources().items()},
        }

    def sources(self) -> dict[str, str]:
        """Return {name: SHA-256} of the modules that diagram and objectives, which are names, import."""
        functions = [given["function"] if isinstance(given, dict) else given for given in self.objectives.values()]
        return modules.sources(Path(self.diagram), functions)


Described = TypeVar("Described", bound=Study)


def read(path: Path, describe: Callable[[dict[str, Any]], Described]) -> Described:
    """Read the TOML file of a study. Raises BadInput, which names the file.

    describe : returns the description of the file's content, as `described`
    """
    if path.suffix != ".toml":
        raise BadInput(f"{path}: expected the TOML file of a study, such as study.toml")
    try:
        content = tomllib.loads(read_small(path).decode("utf-8-sig"))
    except (OSError, UnicodeDecodeError) as error:
        raise BadInput(f"cannot read the study {path}: {getattr(error, 'strerror', None) or error}") from None
    except (ValueError, RecursionError) as error:
        raise BadInput(f"{path}: {error}") from None
    try:
        return describe(content)
    except BadInput as error:
        raise BadInput(f"{path}: {error}") from None


def read_study(content: Mapping[str, Any]) -> Study:
    """Return the Study of a mapping with the keys of a TOML file. Raises BadInput."""
    check_keys(content)
    return Study(**content)


def check_keys(content: Mapping[str, Any]) -> None:
    """Raise BadInput for keys that no study has, missing keys, and tables that are none."""
    for key in content:
        if key not in KEYS:
            raise BadInput(f"unknown key {key!r}; {suggestion(key, KEYS) or 'the keys are ' + ', '.join(KEYS)}")
    for key in ("diagram", "duration"):
        if key not in content:
            raise BadInput(f"missing key {key!r}")
    for key in TABLES:
        if not isinstance(content.get(key, {}), Mapping):
            raise BadInput(f"{key} = {content[key]!r}: expected a table of names and values")


def _is_number(value):
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _is_finite(value):
    return _is_number(value) and math.isfinite(value)


def _is_value(value):
    if isinstance(value, float):
        return not math.isnan(value)
    return isinstance(value, str) or (isinstance(value, int) and _fits(value))


def _fits(value):
    """Return whether a column of the table holds an integer."""
    return -(2**63) <= value < 2**63


def _check_distinct(name, values):
    """Raise BadInput for a value that is given twice: its trials would be equal, and no independent repetitions."""
    known = set()
    for value in values:
        if (type(value), value) in known:
            raise BadInput(f"{name}: {value!r} is given twice, and equal trials have equal results")
        known.add((type(value), value))


def _check_distribution(name, given):
    """Raise BadInput for a distribution that has no samples."""
    where = f"sample: {name} = {given!r}"
    kind, numbers = next(iter(given.items())) if isinstance(given, dict) and len(given) == 1 else (None, None)
    if kind not in DISTRIBUTIONS:
        raise BadInput(f"{where}: expected one of {', '.join(DISTRIBUTIONS)}, as in {{uniform = [0.5, 1.5]}}")
    if not isinstance(numbers, list) or len(numbers) != 2 or not all(map(_is_finite, numbers)):
        raise BadInput(f"{where}: expected two numbers, as in {{{kind} = [0.5, 1.5]}}")
    if kind == "normal" and numbers[1] < 0.0:
        raise BadInput(f"{where}: expected a mean and a standard deviation of 0 or more")
    if kind != "normal" and not (0.0 if kind == "log_uniform" else -math.inf) < numbers[0] <= numbers[1] < math.inf:
        raise BadInput(f"{where}: expected a lower and an upper limit" + ", above 0" * (kind == "log_uniform"))


def _draw(name, given, count, seed):
    """Return the samples of one parameter, which do not depend on the other parameters."""
    (kind, numbers) = next(iter(given.items()))
    return DISTRIBUTIONS[kind](np.random.default_rng(derive_seed(seed, name)), count, *numbers).tolist()
