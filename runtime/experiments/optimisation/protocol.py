"""Sequence of an optimisation with a wearer: propose, confirm, ramp, settle, measure; then validation trials.

It has no clock and no process of its own: `step` receives the time, `press` the keys. Whatever it does or does not do,
the run continues with parameters within their proved bounds, and its stop does not depend on it.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Generator, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from runtime.experiments.optimisation.costs import Cost, Missing
from runtime.experiments.optimisation.finding import DEVIATE, difference, finding, more
from runtime.experiments.optimisation.metabolic import Estimate
from runtime.experiments.optimisation.optimisers import Optimiser
from runtime.experiments.optimisation.parameters import within_step
from runtime.host.console.styles import count

Steps = Generator[None, None, Any]

RETRY_LIMIT = 2  # repetitions of a missing measurement without a confirmation
STAGE_TIME = 5.0  # s between two largest steps on the way to values that are further away
NUMERALS = "0123456789.,-+e"
BACKSPACE = ("\x7f", "\x08")
HELP = "y: apply; n: skip to another proposal; p: pause; r: repeat the measurement; space: stop the robot"


class Refused(Missing):
    """A change of parameters that the run has not applied. The text is the reason."""


class Skipped(Exception):
    """The operator has skipped the evaluation."""


class Repeated(Exception):
    """The operator repeats the measurement."""


class Paused(Exception):
    """The operator has paused the optimisation."""


class Interfered(Exception):
    """Another process has changed a parameter. The text names it."""


class Abandoned(Exception):
    """The optimisation cannot continue without an operator. The text is the reason."""


class Robot:
    """Run whose parameters are optimised.

    running : whether the loop runs, armed and without a fault
    tick : newest tick
    """

    running: bool
    tick: int

    def apply(self, values: Mapping[str, float], zero: bool) -> bool:
        """Begin to ramp parameters, each by at most its largest step from its present value.

        values : {name of a parameter of the optimisation: value}
        zero : whether the assistance is off

        Returns whether the ramps end at `values`; otherwise further calls are necessary. Raises Refused, and then
        nothing was changed.
        """
        raise NotImplementedError

    def has_arrived(self) -> bool:
        """Return whether all ramps have ended."""
        raise NotImplementedError

    def interference(self) -> str | None:
        """Return the path of a parameter that was changed since `apply` by another process; None without one."""
        return None

    def value_text(self, name: str, value: float) -> str:
        """Return the value of a parameter with its unit."""
        return f"{value:.6g}"


@dataclass(frozen=True)
class Settings:
    """Settings of an optimisation.

    evaluations : number of evaluations
    settle, measure : s after the ramp before the measurement, and of the measurement
    confirm : whether the operator confirms each change
    attended : whether an operator can press keys
    validations : validation trials of each condition
    zero : whether "zero", without assistance, is one of their conditions
    reference : evaluations between two measurements of the initial parameters, 0 without them
    rest_every, rest : s of walking before each rest break, and its duration
    walking_limit : s of walking, after which no measurement begins
    seed : seed of the order of the validation trials
    """

    evaluations: int
    settle: float
    measure: float
    confirm: bool = True
    attended: bool = True
    validations: int = 0
    zero: bool = False
    reference: int = 0
    rest_every: float = math.inf
    rest: float = 0.0
    walking_limit: float = math.inf
    seed: int = 0

    @classmethod
    def of(cls, plan: Mapping[str, Any], population: int) -> Settings:
        """Return the settings of a plan of runtime.experiments.optimisation.process, by default with a reference
        before each generation.

        population : evaluations of a generation
        """
        given = plan["settings"]
        reference = population if given["reference"] is None else given["reference"]
        return cls(plan["generations"] * population, **{**given, "reference": reference})

    @property
    def duration(self) -> float:
        """Duration of a measurement with its time to settle, in s."""
        return self.settle + self.measure

    def schedule(self, done: int = 0) -> list[str]:
        """Return the line on the number and the duration of all measurements. done : number of those before"""
        trials = self.evaluations + self.references(self.evaluations) + len(self.order()) - done
        walking = trials * self.duration
        text = f"{count(trials, 'measurement')} of {self.duration:g} s: {walking / 60.0:.0f} min"
        if walking > self.rest_every:
            breaks = math.ceil(walking / self.rest_every) - 1
            text += f" of walking, and {count(breaks, 'rest break')} of {self.rest / 60.0:g} min"
        if walking > self.walking_limit:
            text += f"; the limit of {self.walking_limit / 60.0:g} min of walking allows fewer evaluations"
        return [text]

    def references(self, evaluations: int) -> int:
        """Return how many reference measurements precede an evaluation, or the end. evaluations : number before it"""
        return 1 + evaluations // self.reference if self.reference else 0

    def order(self) -> list[str]:
        """Return the conditions of the validation trials in a random order, each as often in each repetition."""
        source, conditions = random.Random(self.seed), ["found", "initial", *["zero"] * self.zero]
        return [name for _ in range(self.validations) for name in source.sample(conditions, len(conditions))]


class Protocol:
    """Optimisation with a wearer.

    optimiser : Optimiser, with the costs that were measured before if the optimisation continues
    robot : the run
    cost : its source
    settings : Settings
    report : function that records an event: report(step, lines, **fields)
    save : function that stores the state after each result
    accepted : last parameters whose cost was measured; None for the initial ones
    validated : [(condition, Estimate)] of the validation trials before
    expectation : lines on what the protocol can resolve, which precede the first question

    walked : s of walking since the first change: all time but that of rest breaks
    over : whether it has ended
    finished : whether it has ended with the last measurement
    question : number of the newest question to the operator; keys that were pressed before it was shown have no effect
    """

    def __init__(
        self,
        optimiser: Optimiser,
        robot: Robot,
        cost: Cost,
        settings: Settings,
        report: Callable[..., None],
        save: Callable[[], None] = lambda: None,
        accepted: Mapping[str, float] | None = None,
        validated: list[tuple[str, Estimate]] | None = None,
        expectation: Iterable[str] = (),
    ) -> None:
        self.optimiser, self.robot = optimiser, robot
        self.cost, self.settings = cost, settings
        self._report, self.save = report, save
        self.initial = {parameter.name: parameter.start for parameter in optimiser.parameters}
        self.accepted = dict(self.initial if accepted is None else accepted)
        self.validated = list(validated or ())
        self.expectation = list(expectation)
        self.errors: list[float] = []  # standard errors of the costs measured here
        self.now, self.phase, self.until = 0.0, "start", math.inf
        self.walked, self.rested, self.began, self.warned = 0.0, 0.0, False, False  # rested : walked at the last break
        self.title, self.text, self.entered = "", "", False
        self.over, self.finished = False, False
        self.question = 0
        self._pressed: str | None = None
        self._run = self._steps()

    # Of the caller

    def step(self, now: float) -> bool:
        """Continue up to the next wait. now : s. Returns whether the optimisation has ended."""
        if self.began and self.phase != "rest":
            self.walked += now - self.now
        self.now = now
        if self.walked >= self.settings.walking_limit and not self.warned:
            self.warned = True
            limit = f"the limit of {self.settings.walking_limit / 60.0:g} min of walking is reached"
            self.report("limit", [f"{limit}. Let the wearer stop, then stop the robot with the space bar"])
        if not self.over:
            self.cost.take(now)
            try:
                next(self._run)
            except StopIteration:
                self.over = True
            except Abandoned as error:
                self.over = True
                self.report("abandoned", [f"optimisation ended: {error}"], reason=str(error))
            self._pressed = None
        return self.over

    def press(self, key: str, question: int | None = None) -> None:
        """Take a key, a character or the name of one. question : number of its question; None for the newest"""
        if question not in (None, self.question):
            self.report(
                "ignored", [f"{key} was pressed before the question was shown, or too long ago: press it again"]
            )
            return
        if self.phase == "type" and (key in NUMERALS or key in BACKSPACE or key == "enter"):
            self.text = self.text[:-1] if key in BACKSPACE else self.text + key * (key != "enter")
            self.entered = key == "enter"
        elif key in ("y", "n", "p", "r"):
            self._pressed = key

    @property
    def typing(self) -> bool:
        """Whether keys are characters of a number."""
        return self.phase == "type"

    @property
    def status(self) -> str:
        """One line that states the condition for which it waits."""
        left = f" {max(0.0, self.until - self.now):.0f} s" if self.until < math.inf else ""
        words = {
            "confirm": "y applies, n skips",
            "paused": "paused, p continues",
            "rest": "rest, then y continues" if self.settings.attended else "rest",
            "type": f"type the cost, then Enter: {self.text}_",
        }
        return f"{self.title} {words.get(self.phase, self.phase)}{left}".strip()

    # Waiting

    def _wait(self, phase: str, done: Callable[[], bool], until: float = math.inf) -> Steps:
        """Wait for a condition. Raises as keys and other processes request."""
        self.phase, self.until = phase, until
        while not done():
            yield
            self._look()

    def _look(self):
        key, self._pressed = self._pressed, None
        if key == "n":
            raise Skipped
        if key == "r" and self.phase in ("settle", "measure", "type"):
            raise Repeated
        if key == "p":
            raise Paused
        if self.phase in ("ramp", "settle", "measure", "type"):
            if not self.robot.running:
                raise Missing("the robot was not running")
            if path := self.robot.interference():
                raise Interfered(path)

    def _ask(self, phase):
        """Begin to wait for the operator: keys that were pressed before do not count."""
        self.phase, self.until, self._pressed = phase, math.inf, None
        self.question += 1

    def _await_confirmation(self) -> Steps:
        """Wait until the operator presses y."""
        if not self.settings.attended:
            raise Abandoned("a confirmation is needed, and no terminal is attached")
        self._ask("confirm")
        while True:
            yield
            if self._pressed == "y" and self.robot.running:
                return
            self._look()

    def _rest(self) -> Steps:
        """Wait for a rest break if one is due; with an operator, until they press y after it."""
        settings = self.settings
        if self.walked - self.rested < settings.rest_every:
            return
        resume = self.now + settings.rest
        self.rested = self.walked
        then = "; then y: the wearer walks again" * settings.attended
        self.report("rest", [f"rest break of {settings.rest / 60.0:g} min: the wearer stands or sits{then}"])
        self._ask("rest")
        self.until = resume
        while self.now < resume or settings.attended and self._pressed != "y":
            yield

    def _affords(self, measurements: int) -> bool:
        """Return whether a number of measurements would end within the limit of walking."""
        return self.walked + measurements * self.settings.duration <= self.settings.walking_limit

    def _ramp(self, values: Mapping[str, float], zero: bool = False) -> Steps:
        """Ramp to values, by no more than the largest step at a time."""
        while True:
            complete = self.robot.apply(values, zero)
            yield from self._wait("ramp", self.robot.has_arrived)
            if complete:
                return
            resume = self.now + STAGE_TIME
            yield from self._wait("ramp", lambda: self.now >= resume)

    def _return(self) -> Steps:
        """Ramp back to the accepted parameters, regardless of keys."""
        while True:
            try:
                yield from self._ramp(self.accepted)
                return
            except (Skipped, Repeated, Paused):
                continue
            except (Missing, Interfered) as error:
                self.report("missing", [f"the accepted parameters are not restored: {error}"], reason=str(error))
                yield from self._insist_on_confirmation()

    def _insist_on_confirmation(self) -> Steps:
        """Wait until the operator presses y; no other key has an effect."""
        while True:
            try:
                yield from self._await_confirmation()
                return
            except (Skipped, Paused):
                continue

    # The sequence

    def _steps(self) -> Steps:
        while not self.robot.running:
            yield
        yield from self._begin()
        evaluations = self.settings.evaluations
        order = self.settings.order()
        while True:
            told = len(self.optimiser.told)
            yield from self._references()
            if told >= evaluations:
                break
            last = self.settings.references(told + 1) - len(self.optimiser.references)
            if not self._affords(1 + last + len(order) - len(self.validated)):
                limit = f"{self.settings.walking_limit / 60.0:g} min of walking"
                self.report("limit", [f"the limit of {limit} ends the evaluations after {told} of {evaluations}"])
                break
            number = told + 1
            proposal = within_step(self.optimiser.parameters, self.accepted, self.optimiser.ask())
            self.title = f"{number}/{evaluations}"
            self.report(
                "proposal",
                [f"proposal {number} of {evaluations}: {self.differences(proposal)}"],
                number,
                values=proposal,
            )
            estimate = yield from self._evaluate(proposal, False, number)
            if estimate is None:
                continue
            self.optimiser.tell(proposal, estimate.value)
            self.accepted = proposal
            self.errors.append(estimate.error)
            self.save()
            best = min(range(number), key=lambda place: self.optimiser.told[place][1])
            lowest = f"; lowest {self.number(self.optimiser.told[best][1])} in evaluation {best + 1}"
            self.report_measurement(f"evaluation {number} of {evaluations}", estimate, number, lowest, values=proposal)
        fit = self.optimiser.fit()
        found = self.optimiser.optimum(fit)
        while len(self.validated) < len(order):
            number = len(self.validated) + 1
            condition = order[number - 1]
            self.title = f"validation {number}/{len(order)}"
            self.report("validation", [f"{self.title}"], number, condition=condition)
            values = self.initial if condition == "initial" else found
            estimate = yield from self._evaluate(values, condition == "zero", number)
            if estimate is None:
                estimate = Estimate(math.nan, math.nan, 0)
            self.validated.append((condition, estimate))
            self.save()
            self.report_measurement(self.title, estimate, number, condition=condition)
        self.title = "found"
        lines = [f"found: {self.values_text(found)}", *finding(self.optimiser, fit, self.robot.value_text, self.number)]
        lines += self.comparison()
        self.report("found", lines, values=found)
        self.accepted = found
        yield from self._return()
        self.phase, self.finished = "ended", True
        self.save()

    def _begin(self) -> Steps:
        """Ramp to the initial parameters, or to the last accepted ones of an optimisation that continues."""
        told = len(self.optimiser.told)
        which = f"after evaluation {told}" if told else "initial"
        self.title = "begin"
        settings = self.settings
        done = told + len(self.optimiser.references) + len(self.validated)
        lines = settings.schedule(done)
        lines += self.expectation
        lines.append(f"{which} parameters: {self.values_text(self.accepted)}")
        self.report("begin", lines + [HELP] * settings.attended, values=self.accepted)
        if self.settings.confirm:
            yield from self._insist_on_confirmation()
        self.began = True
        yield from self._return()

    def _references(self) -> Steps:
        """Measure the cost of the initial parameters, where that is due."""
        total = self.settings.references(self.settings.evaluations)
        while len(self.optimiser.references) < self.settings.references(len(self.optimiser.told)):
            number = len(self.optimiser.references) + 1
            self.title = f"reference {number}/{total}"
            if not self._affords(1 + len(self.settings.order()) - len(self.validated)):
                return
            self.report("reference", [f"{self.title}: the initial parameters"], number, values=self.initial)
            estimate = (yield from self._evaluate(self.initial, False, number)) or Estimate(math.nan, math.nan, 0)
            self.optimiser.tell_reference(estimate.value)
            self.save()
            self.report_measurement(self.title, estimate, number, step="reference measurement")

    def _evaluate(self, values: Mapping[str, float], zero: bool, number: int) -> Steps:
        """Ramp to values and measure their cost. Returns its Estimate; None if the operator has skipped it."""
        confirmed, failures = not self.settings.confirm, 0
        yield from self._rest()
        while True:
            try:
                if not confirmed:
                    yield from self._await_confirmation()
                confirmed = True
                if not self._affords(1):
                    self.report("limit", [f"{self.title}: the limit of walking allows no measurement"], number)
                    yield from self._return()
                    return None
                yield from self._ramp(values, zero)
                self.report("change", [], number, values=values)
                return (yield from self._measurement())
            except Skipped:
                self.report("skipped", [f"{self.title} skipped: the accepted parameters are restored"], number)
                yield from self._return()
                return None
            except Repeated:
                self.report("repeated", [f"{self.title}: the measurement is repeated"], number)
            except Paused:
                self.report("paused", [f"{self.title} paused: the parameters are held. p: continue"], number)
                if (yield from self._hold()):
                    self.report("skipped", [f"{self.title} skipped: the accepted parameters are restored"], number)
                    yield from self._return()
                    return None
                self.report("continued", [], number)
            except Interfered as error:
                text = f"{self.title}: {error} was changed by another process, and the measurement is discarded. "
                self.report("interfered", [text + "y: ramp to the proposal again; n: skip"], number, path=str(error))
                confirmed = False
            except Missing as error:
                failures += 1
                confirmed = not self.settings.confirm and failures <= RETRY_LIMIT
                then = "It is measured again" if confirmed else "y: measure again; n: skip"
                text = f"{self.title}: {error}; the accepted parameters are restored. {then}"
                self.report("missing", [text], number, reason=str(error))
                yield from self._return()

    def _hold(self) -> Steps:
        """Wait until the operator presses p, or n. Returns whether it was n."""
        self._ask("paused")
        while True:
            yield
            if self._pressed in ("p", "n"):
                return self._pressed == "n"

    def _measurement(self) -> Steps:
        """Wait, and return the Estimate of the cost."""
        begin, cost = self.now, self.cost
        cost.forget(begin)
        start, stop = begin + self.settings.settle, begin + self.settings.settle + self.settings.measure

        def past(time: float) -> bool:
            cost.check(self.now, begin)
            return self.now >= time

        yield from self._wait("settle", lambda: past(start), start)
        yield from self._wait("measure", lambda: past(stop), stop)
        yield from self._wait("measure", lambda: cost.complete(self.now, stop), stop)
        if cost.typed:
            return (yield from self._typed())
        return cost.estimate(begin, start, stop)

    def _typed(self) -> Steps:
        self.report("question", [f"{self.title}: type the cost, then Enter"])
        while True:
            self.text, self.entered = "", False
            self._ask("type")
            yield from self._wait("type", lambda: self.entered)
            try:
                value = float(self.text.replace(",", "."))
                if math.isfinite(value):
                    return Estimate(value, math.nan, 1)
            except ValueError:
                pass
            self.report("question", [f"{self.text!r}: expected a finite number; type the cost, then Enter"])

    # Reports

    def report(self, step: str, lines: list[str], number: int | None = None, **fields: Any) -> None:
        """Record an event. number : number of the evaluation"""
        lines = [f"tickwork: {line}" for line in lines]
        self._report(step, lines, **({} if number is None else {"number": number}), **fields)

    def report_measurement(
        self, title: str, estimate: Estimate, number: int, rest: str = "", step: str = "measurement", **fields: Any
    ) -> None:
        """Record a measurement."""
        self.report(
            step,
            [f"{title}: {self.number(estimate.value, estimate.error)}{rest}"],
            number,
            cost=estimate.value,
            error=estimate.error,
            samples=estimate.count,
            **fields,
        )

    def number(self, value: float, error: float = math.nan) -> str:
        """Return a cost with its standard error and unit."""
        tolerance = f" ± {error:.2g}" if error == error else ""
        return f"{value:.4g}{tolerance} {self.cost.unit}".rstrip()

    def values_text(self, values: Mapping[str, float]) -> str:
        """Return parameters as text."""
        return ", ".join(f"{name} {self.robot.value_text(name, value)}" for name, value in values.items())

    def differences(self, values: Mapping[str, float]) -> str:
        """Return parameters as text, each with its accepted value before it where that differs."""
        return ", ".join(
            f"{name} "
            + (f"{self.robot.value_text(name, self.accepted[name])} to " if value != self.accepted[name] else "")
            + self.robot.value_text(name, value)
            for name, value in values.items()
        )

    def comparison(self) -> list[str]:
        """Return the lines on the validation trials: the mean of each condition, and whether they differ."""
        lines, trials = [], {}
        for condition in dict.fromkeys(name for name, _ in self.validated):
            estimates = [each for name, each in self.validated if name == condition and math.isfinite(each.value)]
            trials[condition] = [(each.value, each.error) for each in estimates]
            value = sum(each.value for each in estimates) / len(estimates) if estimates else math.nan
            lines.append(f"  {condition}: {self.number(value)}, {count(len(estimates), 'validation trial')}")
        found = trials.pop("found", [])
        for condition, others in trials.items():
            if not found or not others:
                continue
            change, error = difference(found, others)
            text = f"  found less {condition}: {self.number(change, error)}"
            if abs(change) < DEVIATE * error:
                ratio = DEVIATE * error / abs(change) if change else math.inf
                text += f"; not resolved: of each condition, {more(len(found), ratio, 'validation trial')}"
            lines.append(text)
        return lines
