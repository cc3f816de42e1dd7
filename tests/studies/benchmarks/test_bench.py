"""The benchmark says what it promises, adds up, and refuses nonsense; no test asserts a time."""

import csv
import json
import sys
from types import SimpleNamespace

import numpy as np
import pytest

import hardspheres as hs
from analysis import theory
from hardspheres import engine
from studies.benchmarks import prices, scaling
from studies.benchmarks.bench import Bench, bench, measure
from studies.benchmarks.clock import Timing, Windows
from studies.benchmarks.gas import Gas
from studies.benchmarks.suite import Suite, run_suite, suite_named
from studies.cli import main
from studies.report import OutputFolder, Screen

TINY = Gas(n=128, packing_fraction=0.3)
CONTRACT = {"n", "dim", "packing_fraction", "collisions", "seconds", "collisions_per_second"}
CONTRACT |= {"bytes_per_particle", "compressibility_factor", "energy_drift"}


class FakeSystem:
    """A peer made of our own engine, with the interface of spheropack's System."""

    def __init__(self, positions, *, box, potential, seed):
        self.start, self.size, self.seed = (positions, box, potential), box, seed

    def set_velocities(self, velocities):
        positions, box, radius = self.start
        self.simulation = hs.Simulation(hs.Scene(positions, velocities, radius, 1.0, box))

    def run(self, duration):
        self.simulation.run(time=duration)

    n_reflections = property(lambda self: self.simulation.collisions)
    time = property(lambda self: self.simulation.time)
    velocities = property(lambda self: self.simulation.velocities)


@pytest.fixture
def peer(monkeypatch):
    rejection_free = SimpleNamespace(System=FakeSystem, HardSpheres=lambda diameter: diameter / 2)
    module = SimpleNamespace(rejection_free=rejection_free, PeriodicBox=lambda box: box, __version__="fake")
    monkeypatch.setitem(sys.modules, "spheropack", module)
    monkeypatch.setitem(sys.modules, "spheropack.rejection_free", rejection_free)


def command(monkeypatch, *options):
    monkeypatch.setattr(sys, "argv", ["hardspheres", "bench", *map(str, options)])
    try:
        main()
    except SystemExit as end:
        return end.code or 0
    return 0


def test_json_keeps_the_contract(tmp_path, monkeypatch, capsys):
    out = tmp_path / "out"
    options = ("--n", 128, "--packing-fraction", 0.2, "--collisions", 3000, "--out", out, "--json")
    assert command(monkeypatch, *options) == 0
    result = json.loads(capsys.readouterr().out)
    assert result == json.loads((out / "summary.json").read_text())
    assert set(result) >= CONTRACT
    assert (result["n"], result["dim"], result["collisions"]) == (128, 3, 3000)
    assert result["packing_fraction"] == pytest.approx(0.2)
    assert result["collisions_per_second"] == pytest.approx(3000 / result["seconds"])
    assert result["checks"]["passed"] and abs(result["energy_drift"]) < 1e-12
    assert result["discarded_collisions_per_particle"] >= 10
    rows = list(csv.DictReader((out / "windows.csv").open()))
    assert len(rows) == result["windows"] == 20
    assert sum(int(row["collisions"]) for row in rows) == 3000
    assert sum(float(row["seconds"]) for row in rows) == pytest.approx(result["seconds"])


def test_every_rate_is_finite_and_ordered():
    result, windows = measure(Bench(TINY, collisions=7))
    assert list(windows["collisions"]) == [1] * 7  # no more windows than collisions
    for clock in ("cpu", "wall"):
        timing = result[clock]
        assert np.isfinite(list(timing.values())).all()
        low, high = timing["lower_quartile"], timing["upper_quartile"]
        assert 0 < low <= timing["median"] <= high <= timing["best"]
    assert np.isnan(Timing.of(np.array([2.0])).standard_error)


def test_the_parts_of_a_collision_add_up(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr("studies.benchmarks.bench.LEAST_LOOKS", 5)
    out = OutputFolder(tmp_path / "out")
    summary, sound = bench(Bench(TINY, collisions=400_000), out, Screen())
    breakdown = summary["breakdown"]
    parts = breakdown["parts"].values()
    assert sound and sum(part["share"] for part in parts) == pytest.approx(1.0)
    whole = sum(part["nanoseconds_per_collision"] for part in parts)
    assert whole == pytest.approx(1e9 / summary["cpu"]["median"])
    assert 0.1 < breakdown["per_collision"]["stale_events"] < 1.0  # 0.47 in a large gas
    printed = capsys.readouterr().out
    assert "predictions of next events" in printed and "stale events a collision" in printed


def test_nothing_is_said_of_the_parts_of_a_run_too_short_to_see_them(tmp_path, capsys):
    summary, _ = bench(Bench(TINY, collisions=20), OutputFolder(tmp_path / "out"), Screen())
    assert summary["breakdown"] is None
    assert "where the time goes" not in capsys.readouterr().out


def test_a_window_is_less_what_an_idle_call_takes(monkeypatch):
    ticks = iter([0.0, 0.0, 1.0, 1.0, 1.0, 1.0, 4.0, 4.0])  # idle 1 s, then 3 s
    monkeypatch.setattr("studies.benchmarks.clock.time.process_time", lambda: next(ticks))
    monkeypatch.setattr("studies.benchmarks.clock.time.perf_counter", lambda: next(ticks))
    runner = SimpleNamespace(collisions=0, idle=lambda: None)

    def run(collisions):
        runner.collisions += collisions

    runner.run = run
    windows = Windows()
    windows.time(runner, 10)
    assert (windows.collisions, windows.cpu, windows.wall, windows.idle) == ([10], [2.0], [2.0], [1.0])
    assert windows.cpu_rates == windows.wall_rates == [5.0]


def test_the_pressure_is_the_fluids_and_is_noticed_when_it_is_not():
    fluid, _ = measure(Bench(Gas(n=500, packing_fraction=0.49, start="fluid"), collisions=40_000))
    assert fluid["is_fluid"] is True
    crystal, _ = measure(
        Bench(Gas(n=500, packing_fraction=0.49, start="lattice"), collisions=10_000, discard=0)
    )
    assert crystal["is_fluid"] is False  # fcc does not melt so soon
    frozen, _ = measure(Bench(Gas(n=500, packing_fraction=0.55), collisions=100))
    assert frozen["start"] == "crystal" and frozen["theory"] is None and frozen["is_fluid"] is None


@pytest.mark.parametrize(
    ("gas", "periodic"),
    [
        (Gas(n=64, dim=2, packing_fraction=0.3), True),
        (Gas(n=64, packing_fraction=0.2, boundary=("periodic", "periodic", "wall")), False),
        (Gas(n=64, packing_fraction=0.2, diameter_ratio=2.0, fraction=0.25), True),
    ],
)
def test_other_gases(gas, periodic):
    scene = gas.scene(seed=2)
    assert (scene.n, scene.dim) == (gas.n, gas.dim)
    assert scene.packing_fraction == pytest.approx(gas.packing_fraction)
    prediction = gas.theory(scene)
    assert (prediction is not None) == periodic
    if gas.diameter_ratio != 1.0:
        assert np.sum(scene.radii == 1.0) == 16
        species = theory.mixture_compressibility(np.array([48, 16]) / scene.volume, [1.0, 2.0], 3)
        assert prediction.value == pytest.approx(species.value)


def test_a_large_fluid_is_a_small_one_repeated(monkeypatch):
    monkeypatch.setattr("studies.benchmarks.gas.REPEATED_FROM", 500)
    monkeypatch.setattr("studies.benchmarks.gas.PIECE", 64)
    for gas in (
        Gas(n=510, packing_fraction=0.25),
        Gas(n=510, packing_fraction=0.25, diameter_ratio=1.5, mass_ratio=2.0, fraction=0.3),
    ):
        assert gas.repeated
        scene = gas.scene(seed=3)  # 8 boxes of 64, less 2
        assert scene.n == 510 and scene.packing_fraction == pytest.approx(0.25, rel=1e-12)
        assert scene.temperature == pytest.approx(1.0)
        half = scene.box[0] / 2
        inside = np.sort(np.round(scene.positions % half, 9), axis=0)
        assert len(np.unique(inside[:, 0])) < 80  # the same places again and again
        assert len(np.unique(scene.velocities[:, 0])) == 510
    assert not Gas(n=510, packing_fraction=0.25, boundary="wall").repeated
    assert not Gas(n=510, packing_fraction=0.25, start="lattice").repeated


def test_in_turn_with_a_peer(peer):
    result, windows = measure(
        Bench(Gas(n=500, packing_fraction=0.1), collisions=20_000, against="spheropack")
    )
    against = result["against"]
    assert against["name"] == "spheropack fake" and against["collisions"] == sum(windows["peer_collisions"])
    assert len(windows["peer_collisions"]) == result["windows"]
    low, high = against["ratio_quartiles"]
    assert 0 < low <= high and against["ratio_of_bests"] > 0
    assert against["ratio_of_medians"] == result["cpu"]["median"] / against["cpu"]["median"]
    expected = theory.finite_size_compressibility(0.1, 3, 500).value
    # collisions of the peer are counted as ours: noise of Z - 1 is about 1 / sqrt(collisions), five of that
    assert against["compressibility_factor"] == pytest.approx(
        expected, abs=5 * (expected - 1) / np.sqrt(against["collisions"])
    )


def test_in_turn_with_the_plain_gas():
    gas = Gas(n=128, dim=2, packing_fraction=0.2, boundary="wall")
    against = measure(Bench(gas, collisions=200, against="plain"))[0]["against"]
    assert against["name"] == "plain gas"
    expected = theory.compressibility_factor(0.2, 3).value  # of spheres; the discs' is 1.6
    assert against["compressibility_factor"] == pytest.approx(expected, rel=0.1)


def test_a_miniature_suite_leaves_a_table_and_a_figure(tmp_path, peer, capsys):
    suite = Suite("mini", (64, 128), (0.05, 0.2), window_seconds=0.001, peer_up_to=64)
    out = OutputFolder(tmp_path / "suite")
    summary, sound = run_suite(suite, Bench(Gas(), against="spheropack"), out, Screen())
    assert sound and len(summary["states"]) == 4
    rows = list(csv.DictReader((tmp_path / "suite" / "bench.csv").open()))
    assert [(int(row["n"]), float(row["packing_fraction"])) for row in rows] == [
        (64, pytest.approx(0.05)),
        (128, pytest.approx(0.05)),
        (64, pytest.approx(0.2)),
        (128, pytest.approx(0.2)),
    ]
    assert all(float(row["rate_median"]) > 0 for row in rows)
    assert [row["peer_rate_median"] != "" for row in rows] == [True, False, True, False]
    assert (tmp_path / "suite" / "bench.png").stat().st_size > 10_000
    assert capsys.readouterr().out.count("\n") >= 6


def test_an_interrupted_suite_keeps_what_is_done(tmp_path, monkeypatch):
    done = iter([measure, measure])

    def one_then_interrupt(study):
        next(done)
        if study.gas.n == 128:
            raise KeyboardInterrupt
        return measure(study)

    monkeypatch.setattr("studies.benchmarks.suite.measure", one_then_interrupt)
    suite = Suite("mini", (64, 128), (0.2,), window_seconds=0.001, peer_up_to=0)
    with pytest.raises(KeyboardInterrupt):
        run_suite(suite, Bench(Gas()), OutputFolder(tmp_path / "suite"), Screen())
    assert len(list(csv.DictReader((tmp_path / "suite" / "bench.csv").open()))) == 1


def test_suites_take_other_sizes():
    assert suite_named("quick", [500, 100]).sizes == (100, 500)
    assert suite_named("full", None, [0.2]).packing_fractions == (0.2,)


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (["--n", 1], "n = 1 at packing fraction 0.3"),
        (["--packing-fraction", 0.9], "0.9 is above close packing"),
        (["--against", "nonsense"], "--against nonsense is not known"),
        (["--suite", "nonsense"], "--suite nonsense is not known"),
        (["--suite", "quick", "--n", 1], "--n 1: a collision takes two particles; ask for at least 2"),
        (["--start", "nonsense"], "--start nonsense is not known"),
        (["--collisions", 0], "--collisions 0 must be at least 1"),
        (["--discard", -1], "--discard -1 must be at least 0"),
        (["--diameter-ratio", 0], "--diameter-ratio 0 must be positive"),
        (["--boundary", "sticky"], "--boundary sticky is not known; it can be periodic or wall"),
        (["--n", 100, "--n", 200], "--n is given 2 times"),
    ],
)
def test_bad_input_is_one_sentence_and_leaves_no_folder(options, sentence, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert command(monkeypatch, *options) == 2
    shown = capsys.readouterr()
    assert shown.err.startswith("error: ") and sentence in shown.err
    assert shown.err.count("\n") == 1 and shown.out == ""
    assert not list(tmp_path.iterdir())


def test_a_missing_peer_says_how_to_install_it(tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "spheropack", None)
    monkeypatch.chdir(tmp_path)
    assert command(monkeypatch, "--against", "spheropack") == 2
    assert "pip install 'hardspheres[bench]'" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("options", [["--dim", 2], ["--boundary", "wall"], ["--diameter-ratio", 2]])
def test_the_peer_runs_one_kind_of_gas(options, peer, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert command(monkeypatch, "--against", "spheropack", *options) == 2
    assert "compares periodic gases of one kind of sphere in 3D" in capsys.readouterr().err


def test_spheropack_itself_agrees_about_the_pressure():
    pytest.importorskip("spheropack")
    result, _ = measure(Bench(Gas(n=500, packing_fraction=0.3), collisions=20_000, against="spheropack"))
    peer, expected = result["against"], theory.finite_size_compressibility(0.3, 3, 500).value
    assert peer["compressibility_factor"] == pytest.approx(
        expected, abs=(expected - 1) * (0.005 + 5 / np.sqrt(peer["collisions"]))
    )


def test_results_are_shown(tmp_path, capsys):
    bench(Bench(TINY, collisions=200), OutputFolder(tmp_path / "b"), Screen())
    shown = capsys.readouterr().out
    for words in (
        "128 hard spheres",
        "discarded",
        "hardspheres, processor",
        "compressibility factor",
        "bytes per",
    ):
        assert words in shown


def test_a_price_list_in_small(tmp_path, monkeypatch):
    """Tallies only, whose kernels other tests have; ratios are of the two gases named, whatever they are."""
    tallied = {name: prices.FEATURES[name] for name in ("free_paths=True", "heat=True")}
    monkeypatch.setattr(prices, "FEATURES", tallied | {"itself": ("plain", {})})
    study = prices.Prices(n=128, packing_fractions=(0.05,), rounds=5, window=1.0)
    summary, sound = prices.run_prices(study, OutputFolder(tmp_path / "prices"), Screen())
    assert sound and [row["feature"] for row in summary["prices"]] == [*tallied, "itself"]
    assert all(row["ratio"] > 0.0 for row in summary["prices"])
    with (tmp_path / "prices" / "prices.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [float(row["ratio"]) for row in rows] == [row["ratio"] for row in summary["prices"]]


def test_threads_in_small(tmp_path, monkeypatch):
    """Two threads have the bits of one; sibling: with another digest the benchmark says NO, and is not sound."""
    monkeypatch.setattr(engine, "idle_cores", lambda: 2)
    monkeypatch.setattr(scaling, "LEAST", 2000)
    monkeypatch.setattr(scaling, "START_UP", 1.0)
    study = scaling.Scaling(n=(6000,), threads=(1, 2), collisions_per_particle=0.5)
    summary, sound = scaling.run_scaling(study, OutputFolder(tmp_path / "same"), Screen())
    assert sound and [entry["threads"] for entry in summary["scaling"]] == [1, 2]
    assert summary["scaling"][1]["windows"] > 0 == summary["scaling"][0]["windows"]
    with (tmp_path / "same" / "scaling.csv").open() as file:
        assert [row["same_bits"] for row in csv.DictReader(file)] == ["True", "True"]
    monkeypatch.setattr(scaling, "_digest", lambda simulation: str(simulation.threads))
    summary, sound = scaling.run_scaling(study, OutputFolder(tmp_path / "other"), Screen())
    assert not sound and summary["checks"]["failures"] == ["6000 particles on 2 threads have other bits"]


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (["--threads", "2,x"], "--threads 2,x is not understood; give whole numbers from 1 on, with commas"),
        (["--threads", "2", "--dim", "2"], "--threads has gases of its own; leave out --dim"),
        (["--threads", "2", "--suite", "quick"], "--threads and --suite are two measurements"),
        (
            ["--threads", "2", "--packing-fraction", "0.4"],
            "--packing-fraction 0.4: --threads goes up to 0.35",
        ),
    ],
)
def test_threads_of_other_gases_are_refused(options, sentence, monkeypatch, capsys):
    assert command(monkeypatch, *options) == 2
    assert sentence in " ".join(capsys.readouterr().err.split())


def test_gases_of_the_price_list_have_what_their_names_say():
    scenes = {name: prices.gas_with(name, 200, 0.1, 1) for name in ("plain", *prices.FEATURES)}
    plain = scenes.pop("plain")
    for name, scene in scenes.items():
        assert scene.n == 200 and scene.falls == name.startswith("gravity")
        assert scene.periodic.all() != (scene.falls or name == "walls")
        assert (scene.n - scene.n_moving == 4) == ("obstacles" in name)
        assert (len(np.unique(scene.masses)) == 2) == ("mass" in name or "obstacles" in name)
        assert (len(np.unique(scene.radii)) == 2) == ("radius" in name)
        beside, options = prices.FEATURES[name]
        assert beside in {"plain", "walls"} and (bool(options) == ("=" in name))
        if options:
            assert np.array_equal(scene.positions, plain.positions)


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (["--dim", "2"], "--suite prices has gases of its own; leave out --dim"),
        (["--packing-fraction", "0.4"], "--packing-fraction 0.4: a price list goes up to 0.35"),
        (["--n", "20"], "--n 20: a price list needs at least 50 particles"),
        (["--n", "100", "--n", "200"], "--n is given 2 times, but the price list has one; give it once"),
    ],
)
def test_a_price_list_of_other_gases_is_refused(options, sentence, monkeypatch, capsys):
    assert command(monkeypatch, "--suite", "prices", *options) == 2
    assert sentence in capsys.readouterr().err
