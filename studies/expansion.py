"""Free expansion: a gas in half of a box, the other half opened, and the way back; or two halves that mix."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

import hardspheres as hs
from analysis import theory
from analysis.expansion import HALF_WAY, Spreading, in_upper_half
from analysis.statistics import Estimate, TheoryCheck, deviates, estimate_from_jackknife
from analysis.theory import Prediction
from studies.answer import Answer, Column, Curves, alarms, number
from studies.fluid import Fluid, check_spread, collisions_at
from studies.half_full import AXIS, HalfFull
from studies.options import OptionError, dimension, one_number, option, particles, positive, runs, word
from studies.real_fluid import scaled
from studies.report import alarming
from studies.running.resuming import until
from studies.study import Replica, Study
from studies.way_back import WayBack, came_back, retraced, returns, way_back

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from studies.viewer.replay import Replay

__all__ = ["Expansion"]

FEWEST = 16  # particles
MOMENTS = (0.0, 0.25, 0.5, 0.75, 1.0, 1.25, 1.5, 1.75, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0)  # transit times
SHORTEST, LONGEST = 6.0, 30.0  # transit times that are run by default
MOST = 100_000  # transit times: years of computing
DIED_OUT, ENOUGH = 4.0, 3.0  # e-folds of the last wave, or slowest mode of mixing: run by default, needed
STOPS = 48  # on the way there, at which the way back is compared with it
HORIZONS = (0.5, 1.0, 1.5, 2.0, 3.0)  # of retracing, after which velocities are reversed by default
WATCHED = 120  # particles in gas.html
COOLED = 1e-12  # relative change of kT that no rounding makes
LAYERED = 0.01  # entropy that layers at walls take
VAGUE = 0.05  # uncertainty of theory from which on it has no z
PARTS = ("value", "standard_error")  # of an estimate


def _reversals(text: str) -> tuple[float, ...]:
    """Return the collisions per particle that a text names."""
    try:
        found = tuple(sorted({float(part) for part in text.split(",")}))
    except ValueError:
        raise OptionError(f"--reverse-after {text} is not understood; give numbers, as in 2,4,8") from None
    if not all(0.0 < s < math.inf for s in found):
        raise OptionError(
            f"--reverse-after {text}: each must be positive, a number of collisions per particle"
        )
    return found


@dataclass(frozen=True, kw_only=True)
class Expansion(Study):
    """A gas that is let out of half of a box, and its way back; or the mixing of two halves."""

    name = "expansion"
    question = "How does a gas fill a box, and does it go back when all velocities are reversed?"
    explanation = """
    A gas in equilibrium in half of a box is let into the other half: densities and coarse-grained entropy
    against time, beside an ideal gas. Then all velocities are reversed, and the gas goes back for as long as
    no rounding has grown too large, beside the Lyapunov exponent. With --mix the gas fills the box, and the
    particles of its two halves mix, beside Enskog's diffusion. Writes a summary, five tables, a picture and a
    page with a small gas to be watched.
    """
    table = "expansion"
    files = (
        "expansion.csv",
        "spreading.csv",
        "profiles.csv",
        "returns.csv",
        "way_back.csv",
        "expansion.png",
        "gas.html",
    )

    packing_fraction: float = option(
        0.01, **one_number | {"help": "Volume fraction of the spheres at the start, in what they fill then."}
    )
    n: int = particles(1000)
    dim: int = dimension()
    mix: bool = option(False, "The gas fills the box, and the particles of its two halves are told apart.")
    boundary: str = option(
        "periodic",
        "Of the sides of the box; along x there are walls.",
        **word("--boundary", "periodic", "wall"),
    )
    cells: int = option(
        20, "Cells along x for densities and entropy, an even number.", at_least=2, at_most=1000
    )
    transits: float | None = option(
        None,
        "How long to run, in transit times: half of the box over sqrt(kT/m).",
        shown="until waves or mixing have died out, 6 to 30",
        **positive("--transits", "how long to run"),
    )
    reverse_after: tuple[float, ...] | None = option(
        None,
        "Collisions per particle after which all velocities are reversed, several with commas.",
        shown="0.5 to 3 times those that are retraced",
        parser=_reversals,
        metavar="NUMBER|LIST",
    )
    replicas: int = runs(40)
    threads: ClassVar[int] = 1  # type: ignore[misc]  # no option: it makes its gases on the way, small ones

    def gases(self) -> list[HalfFull]:
        """Return the one gas."""
        start = Fluid(self.n, self.dim, self.packing_fraction, ("wall", *[self.boundary] * (self.dim - 1)))
        start.check_within("the theory of its pressure")
        if not self.packing_fraction > 0.0:
            raise hs.SceneError(f"--packing-fraction {self.packing_fraction:g} must be positive")
        if self.n < FEWEST:
            raise hs.SceneError(f"--n {self.n} is too few for densities; ask for at least {FEWEST}")
        if self.cells % 2:
            raise OptionError(f"--cells {self.cells} is odd; the middle of the box must be an edge of cells")
        check_spread(self.replicas)
        if self.transits is not None and self.transits > MOST:
            raise OptionError(f"--transits {self.transits:g} would never end; ask for at most {MOST}")
        gas = HalfFull(start, self.mix)
        end = self.length(gas) * gas.half * gas.rate
        if self.reverse_after is not None and self.reverse_after[-1] > end:
            raise OptionError(
                f"--reverse-after {self.reverse_after[-1]:g} is later than the run, which has about "
                f"{end:.2g} collisions per particle; ask for less, or for more --transits"
            )
        return [gas]

    def length(self, gas: HalfFull) -> float:
        """Return how long to run, in transit times."""
        return self.transits or float(np.clip(DIED_OUT / gas.decay, SHORTEST, LONGEST))

    def moments(self, gas: HalfFull) -> list[float]:
        """Return when densities are measured, in transit times: dense early, later by steps of a third."""
        end, points = self.length(gas), list(MOMENTS)
        while points[-1] < end:
            points.append(float(f"{points[-1] * 4 / 3:.2g}"))
        return [t for t in points if t < end * 0.98] + [end]

    def reversals(self, gas: HalfFull) -> list[float]:
        """Return the collisions per particle after which all velocities are reversed."""
        if self.reverse_after is not None:
            return list(self.reverse_after)
        end = 0.9 * self.length(gas) * gas.half * gas.rate
        horizon = float(gas.horizon.value)
        wanted = [h * horizon for h in HORIZONS] if math.isfinite(horizon) else [0.3 * end, end]
        return sorted({float(f"{min(s, end):.2g}") for s in wanted})

    def stops(self, gas: HalfFull) -> dict[int, bool]:
        """Return the pair collisions after which the way there is looked at, and whether it is reversed."""
        reversals = self.reversals(gas)
        found = {0: False}
        for begin, end in itertools.pairwise([0.0, *reversals]):
            count = max(4, round(STOPS * (end - begin) / reversals[-1]))
            for s in np.linspace(begin, end, count + 1)[1:]:
                found.setdefault(max(1, collisions_at(s, gas.n)), False)
            found[max(found)] = True
        return found

    def estimators(self, gas: HalfFull, simulation: hs.Simulation) -> dict[str, Any]:
        """Return what measures where the particles are, there and on the way back."""
        return {"there": self._spreading(gas), "back": WayBack()}

    def _spreading(self, gas: HalfFull) -> Spreading:
        return Spreading(AXIS, self.cells, None if self.mix else gas.half - 0.5)

    def advance(self, gas: HalfFull, replica: Replica) -> Iterator[None]:
        """Equilibrate and open the box; go there and back, then the whole way there."""
        there, back = replica.estimators["there"], replica.estimators["back"]
        if replica.done == 0:
            yield from until(replica.simulation, gas.settled)
            replica.seen["temperature"] = replica.simulation.temperature
            opened = gas.opened(replica.simulation.to_scene())
            replica.running, back.ahead = hs.Simulation(opened), hs.Simulation(opened)
            replica.done = 1
            yield
        if back.ahead is not None:
            yield from back.go(self.stops(gas), self.cells)
        moments = [t * gas.half for t in self.moments(gas)]
        for frame in replica.simulation.frames(times=moments[replica.done - 1 :]):
            there.add(frame)
            replica.done += 1
            yield
        replica.seen["cooled"] = replica.simulation.temperature / replica.seen["temperature"] - 1.0

    def answer(self, gas: HalfFull, replicas: Sequence[Replica]) -> Answer:
        """Return numbers and curves, with errors from the spread of the replicas."""
        there = self._spreading(gas)
        for replica in replicas:
            there.merge(replica.estimators["there"])
        back = [replica.estimators["back"] for replica in replicas]
        spreading, failures = _spreading(gas, there)
        came, lost = returns(gas, back)
        cooled = max((replica.seen["cooled"] for replica in replicas), key=abs)
        died_out = gas.decay * self.length(gas)
        horizon = retraced(gas, back)
        numbers = [
            _half_time(gas, there),
            _last_entropy(there, died_out),
            _fluctuations(gas, there, died_out),
            *horizon,
            number("change of kT, relative", cooled),
        ]
        if abs(cooled) > COOLED:
            failures.append(
                f"kT has changed by {cooled:.1e} of itself: free expansion does not cool this gas"
            )
        notes = [came_back(came)]
        if not horizon:
            notes.append(
                "every way back was retraced, or nearly: ask for a later --reverse-after to see the end"
            )
        if there.layering > LAYERED:
            notes.append(
                f"the {self.cells} cells are so narrow that they show layers of particles at the walls: the "
                "entropy stays below ln 2; ask for fewer --cells"
            )
        if died_out < ENOUGH:
            slow = "the halves have not mixed" if self.mix else "waves have not died out"
            enough = math.ceil(DIED_OUT / gas.decay)
            notes.append(f"{slow} at the end: no theory of the entropy there; ask for --transits {enough}")
        return Answer(
            gas,
            numbers,
            {
                "spreading": spreading,
                "returns": came,
                "profiles": _profiles(gas, there),
                "way_back": way_back(gas, back),
            },
            notes=notes,
            failures=[*failures, *lost, *alarms(numbers)],
            details={
                "knudsen_number": gas.knudsen,
                "transit_time": gas.half,
                "retraced_in_theory": float(gas.horizon.value),
                "theory": there.theory_name,
            },
            hidden={"there": there},
        )

    def legend(self, answers: Sequence[Answer]) -> list[str]:
        """Return what the columns are."""
        gas: HalfFull = answers[0].gas
        who = "of those from the left" if self.mix else "of the particles"
        if self.mix:
            how = "Gaussian displacements with Enskog's D, velocities forgotten exponentially"
        else:
            how = (
                "no collisions, exact for an ideal gas; its uncertainty is what collisions were found to "
                "change, 0.008 for each one per particle"
            )
        columns = (
            "t: time in transit times, half of the box over sqrt(kT/m); s: collisions per particle; right: "
            f"share {who} in the right half; S: entropy of the density in {self.cells} cells along x, per "
            "particle, 0 for one half and ln 2 = 0.6931 for all of the box, of all replicas together, so "
            "that few particles in a cell do not lower it"
        )
        back = (
            "reversed: collisions per particle after which all velocities were reversed; left: share in the "
            "left half then; on return: after as long again; off: root mean square distance from the start "
            "on return, in diameters, beside one rounding of the box, grown by the Lyapunov exponent; "
            "retraced: until it is a tenth of a diameter"
        )
        return [
            f"mean free path at the start over half of the box (Knudsen number): {gas.knudsen:.3g}",
            columns,
            f"theory: {how}",
            back,
            "errors from the spread of the replicas",
        ]

    def figure(self, answers: Sequence[Answer]) -> Figure:
        """Return densities, entropy, and the way back."""
        from studies.figures.expansion import figure

        return figure(answers[0])

    def replay(self) -> Replay | None:
        """Return a small gas of this kind from the opening on; None where it has no room."""
        from studies.viewer.replay import replay_by_steps

        start = Fluid(min(self.n, WATCHED), self.dim, self.packing_fraction, self.gases()[0].start.boundary)
        gas = HalfFull(start, self.mix)
        length = 3.0 * gas.half * gas.rate
        try:
            simulation = hs.Simulation(gas.scene(np.random.SeedSequence(self.seed, spawn_key=(0,))))
            simulation.run(collisions=gas.settled)
            return replay_by_steps(gas.opened(simulation.to_scene()), float(np.clip(length, 1.0, 20.0)))
        except hs.HardSpheresError:
            return None


def _spreading(gas: HalfFull, there: Spreading) -> tuple[Curves, list[str]]:
    """Return share in the right half and entropy against time, and a sentence where theory fails."""
    freedom = there.n_replicas - 1.0
    expected, entropy, found = there.theory, there.theory_entropy, there.entropies
    crossed, error = there.crossed, there.crossed_error
    moved = there.time > 0.0
    told = moved & (expected.uncertainty < VAGUE)
    z = deviates(np.where(told, crossed - expected.value, np.nan), error, expected.uncertainty, freedom)
    value, spread = (np.array([getattr(each, name) for each in found]) for name in PARTS)
    z_entropy = deviates(np.where(told, value - entropy.value, np.nan), spread, entropy.uncertainty, freedom)
    failures = []
    worst = int(np.argmax(np.nan_to_num(np.abs(z))))
    at_worst = Estimate(float(crossed[worst]), float(error[worst]), degrees_of_freedom=freedom)
    time = there.time / gas.half
    if alarming(at_worst, expected.value[worst], expected.uncertainty[worst]):
        failures.append(
            f"the share in the right half is {z[worst]:+.1f} standard errors from theory at t = "
            f"{time[worst]:.3g}"
        )
    columns = {
        "right": Column(crossed, error, expected.value, expected.uncertainty, z, brief=True),
        "entropy": Column(value, spread, entropy.value, entropy.uncertainty, z_entropy, "S", brief=True),
    }
    return Curves({"t": time, "s": there.s}, columns, printed=True), failures


def _profiles(gas: HalfFull, there: Spreading) -> Curves:
    """Return densities in all cells at all moments, over that of the particles spread evenly."""
    cells, shares, error = there.cells, there.shares, there.shares_error
    middle = 0.5 * (there.edges[1:] + there.edges[:-1])
    density = Column(
        (cells * shares).ravel(),
        (cells * error).ravel(),
        (cells * there.expected(there.time)).ravel(),
    )
    axes = {"t": np.repeat(there.time / gas.half, cells), "x": np.tile(middle, len(there.time))}
    return Curves(axes, {"density": density})


def _half_time(gas: HalfFull, there: Spreading) -> TheoryCheck:
    """Return when half of what the right half holds at last has come, in transit times."""
    quantity = "half-time, in transit times"
    if not there.crossed.max() > HALF_WAY:
        return number(quantity, math.nan)
    (check,) = there.checks
    return scaled(check, quantity, 1.0 / gas.half)


def _last_entropy(there: Spreading, died_out: float) -> TheoryCheck:
    """Return the entropy at the last moment beside ln 2, less what waves and layers at walls leave."""
    expected = None
    if died_out >= ENOUGH:
        expected = Prediction(math.log(2.0), max(there.layering + math.exp(-2.0 * died_out), 1e-5))
    return number("entropy at the end, per particle", there.entropies[-1], "ln 2", expected)


def _fluctuations(gas: HalfFull, there: Spreading, died_out: float) -> TheoryCheck:
    """Return the variance of the number in the right half, over that of free particles, late in the run.

    Theory: in two halves of a large system it is that of free particles times rho kT times the isothermal
    compressibility, 1/(Z + eta Z'); half of that deviation where half of the particles are followed. u: how
    much of the box is within two diameters of the plane between them.
    """
    late = there.time >= 0.5 * there.time[-1]
    counts = there.samples[:, late]
    followed = counts.sum(axis=2)
    off = (2.0 * in_upper_half(counts) - followed) / np.sqrt(followed)
    moments = np.stack([off, off * off], axis=2)  # waves that all replicas share are no fluctuation
    found = estimate_from_jackknife(moments, lambda mean: float(np.mean(mean[:, 1] - mean[:, 0] ** 2)))
    z = float(theory.compressibility_factor(gas.spread, gas.dim).value)
    slope = float(theory.compressibility_slope(gas.spread, gas.dim))
    less = (1.0 - 1.0 / (z + gas.spread * slope)) * (0.5 if gas.mix else 1.0)
    expected = Prediction(1.0 - less, less * min(2.0 / gas.half, 1.0)) if died_out >= ENOUGH else None
    return number("variance in the right half, over free ones'", found, "compressibility", expected)
