"""The command `hardspheres bench`: one gas, or a table of many."""

from __future__ import annotations

import itertools
import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import hardspheres as hs
from hardspheres.memory import require_room_for
from studies.benchmarks.bench import Bench, bench
from studies.benchmarks.gas import STARTS, Gas
from studies.benchmarks.prices import Prices, run_prices
from studies.benchmarks.rivals import PEERS
from studies.benchmarks.scaling import Scaling, run_scaling
from studies.benchmarks.suite import QUESTION, SUITES, Suite, run_suite, suite_named
from studies.options import (
    OptionError,
    boundary,
    diameter_ratio,
    dimension,
    mass_ratio,
    option,
    packing_fractions,
    seed,
    whole_numbers,
    word,
)
from studies.program import Program
from studies.report import OutputFolder, Screen
from studies.running.ownership import SUMMARY

__all__ = ["Benchmark", "next_folder"]


def _sizes(text: str) -> tuple[int, ...]:
    return whole_numbers("--n", text)


def _numbers_of_threads(text: str) -> tuple[int, ...]:
    return whole_numbers("--threads", text)


@dataclass(frozen=True, kw_only=True)
class Benchmark(Program):
    """Collisions per second of the event loop alone."""

    name = "bench"
    question = QUESTION
    explanation = """
    Times the event loop alone, compiled and in equilibrium, on one core. Writes a summary and the windows;
    with --suite a table and a figure. Keeps no checkpoints, since an interruption would invalidate the
    timing.
    """
    files = (*Bench.files, *Suite.files, *Prices.files, *Scaling.files)
    resumable = False

    n: tuple[tuple[int, ...], ...] = option(
        (),
        "Particles; with --suite or --threads several, with commas.",
        several=True,
        shown="4000",
        metavar="NUMBER|LIST",
        parser=_sizes,
    )
    dim: int = dimension()
    packing_fraction: tuple[tuple[float, ...], ...] = option(
        (),
        "Volume fraction of the spheres; with --suite several: first:last:count, or numbers with commas.",
        several=True,
        shown="0.3",
        metavar="NUMBER|LIST",
        parser=packing_fractions,
    )
    boundary: str | tuple[str, ...] = option("periodic", **boundary)
    diameter_ratio: float = diameter_ratio()
    mass_ratio: float = mass_ratio()
    fraction: float = option(0.5, "Number fraction of the second species.", at_least=0.0, at_most=1.0)
    start: str = option(
        "auto",
        "lattice: a crystal with random velocities. fluid: at random, grown where it is dense. auto: a fluid "
        "where that is the equilibrium state.",
        **word("--start", *STARTS),
    )
    collisions: int | None = option(None, "Collisions to time, in 20 windows.", shown="4 s worth")
    discard: float | None = option(
        None,
        "Collisions per particle to discard before timing.",
        shown="10, more where it must melt or relax",
    )
    against: str | None = option(
        None,
        "spheropack: run it in turn with ours and compare; plain: our own engine on as many equal spheres, "
        "periodic, in 3D.",
        **word("--against", *PEERS),
    )
    suite: str | None = option(
        None,
        "quick (3 min) or full (10 to 20 min): a table over N and packing fraction, with a figure. prices (6 "
        "min): what walls, gravity, tallies and the like cost.",
        **word("--suite", *SUITES, "prices"),
    )
    threads: tuple[tuple[int, ...], ...] = option(
        (),
        "Numbers with commas, as in 1,2,4: the same gas on so many threads, and the speed-up.",
        several=True,
        shown="one thread",
        metavar="LIST",
        parser=_numbers_of_threads,
    )
    seed: int = seed()

    def conduct(self, out: OutputFolder, screen: Screen) -> tuple[dict[str, Any], bool]:
        """Time one gas, or those of a suite."""
        densities = [eta for several in self.packing_fraction for eta in several]
        sizes = tuple(n for several in self.n for n in several)
        if threads := tuple(count for several in self.threads for count in several):
            return run_scaling(self._scaling(sizes, threads, densities), out, screen, self.made())
        gas = Gas(
            (sizes or (4000,))[0],
            self.dim,
            (densities or [0.3])[0],
            self.boundary,
            self.diameter_ratio,
            self.fraction,
            self.start,
            self.mass_ratio,
        )
        study = Bench(gas, self.collisions, self.discard, self.against, self.seed)
        if self.suite == "prices":
            return run_prices(self._prices(sizes, densities), out, screen, self.made())
        if self.suite is not None:
            return run_suite(suite_named(self.suite, sizes, densities), study, out, screen, self.made())
        if out.figure_format != "png":
            raise OptionError(f"--format {out.figure_format} goes with --suite: a single state has no figure")
        for name, given in (("--n", sizes), ("--packing-fraction", densities)):
            if len(given) > 1:
                raise hs.SceneError(f"{name} is given {len(given)} times, but one state has one; add --suite")
        return bench(study, out, screen, self.made())

    def _require_plain(self, whose: str) -> None:
        """Refuse options of a gas where there are gases of their own."""
        own = Benchmark()
        for name in (
            "dim", "boundary", "diameter_ratio", "mass_ratio", "fraction", "start", "collisions", "discard",
            "against",
        ):  # fmt: skip
            if getattr(self, name) != getattr(own, name):
                raise OptionError(f"{whose} has gases of its own; leave out --{name.replace('_', '-')}")

    def _scaling(self, sizes: tuple[int, ...], threads: tuple[int, ...], densities: list[float]) -> Scaling:
        """Return what to measure on several threads: equal spheres in 3D."""
        self._require_plain("--threads")
        if self.suite is not None:
            raise OptionError("--threads and --suite are two measurements; give one of them")
        if len(densities) > 1:
            raise OptionError(f"--packing-fraction is given {len(densities)} times; --threads takes one")
        if densities and densities[0] > 0.35:
            raise OptionError(f"--packing-fraction {densities[0]:g}: --threads goes up to 0.35")
        sizes = sizes or (100_000,)
        require_room_for(max(sizes))
        scaling = Scaling(sizes, threads, seed=self.seed)
        return replace(scaling, packing_fraction=densities[0]) if densities else scaling

    def _prices(self, sizes: tuple[int, ...], densities: list[float]) -> Prices:
        """Return where to measure the price list; it has gases of its own."""
        self._require_plain("--suite prices")
        if len(sizes) > 1:
            raise OptionError(f"--n is given {len(sizes)} times, but the price list has one; give it once")
        if sizes and sizes[0] < 50:
            raise OptionError(f"--n {sizes[0]}: a price list needs at least 50 particles")
        if densities and max(densities) > 0.35:
            raise OptionError(f"--packing-fraction {max(densities):g}: a price list goes up to 0.35")
        prices = Prices(seed=self.seed)
        n, etas = (sizes or (prices.n,))[0], tuple(sorted(densities)) or prices.packing_fractions
        require_room_for(n)
        return replace(prices, n=n, packing_fractions=etas)

    def folder(
        self, out: Path | None, checkpoint_every: float = 60.0, resume: bool = False, force: bool = False
    ) -> OutputFolder:
        """Return the output folder: without --out the next free one, as a timing is repeated, not resumed."""
        return OutputFolder(out or next_folder(Path("runs") / f"{self.name}-{self.seed}", force), force=force)


def next_folder(path: Path, force: bool) -> Path:
    """Return the first of path, path-2, path-3, ... without results."""
    names, taken = {SUMMARY, *Benchmark.files}, path
    for number in itertools.count(2):
        if force or not any(os.path.lexists(taken / name) for name in names):
            break
        taken = path.with_name(f"{path.name}-{number}")
    return taken
