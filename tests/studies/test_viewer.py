"""The viewer: the page's data and program give the positions of the engine, forwards and backwards."""

import base64
import html
import json
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scenes import everything, gas

import hardspheres as hs
import hardspheres.kernel
import studies.viewer
from analysis.theory import equilibrium_a2
from hardspheres.event_log import event_dtype
from studies import view
from studies.cli import main
from studies.thermalisation import Thermalisation
from studies.viewer import replay as replays
from studies.viewer.command import View
from studies.viewer.replay import Replay, replay_by_steps

from . import browser as chromium

MODULE = Path(studies.viewer.__file__).parent / "viewer.mjs"
GASES = {
    "3d": {"n": 40, "packing_fraction": 0.2},
    "2d": {"n": 40, "packing_fraction": 0.3},
    "3d_walls": {"n": 40, "packing_fraction": 0.2},
    "3d_mixture": {"n": 40, "packing_fraction": 0.2},
    "2d_mixture_walls": {"n": 40, "packing_fraction": 0.2},
}
QUICK = (
    "3d",
    "2d_mixture_walls",
)  # both dimensions, walls and a mixture: kernels with a log compile for each kind
LONG = ("3d_walls",)  # its walls and its dimension are those of others
KINDS = [
    kind
    if kind in QUICK
    else pytest.param(kind, marks=pytest.mark.long if kind in LONG else pytest.mark.slow)
    for kind in GASES
]
CLOSE = 1e-9  # diameters
MOMENTS = 20


def script(page, name):
    """The text of one of the page's data scripts."""
    return re.search(rf'<script type="[^"]*" id="{name}">(.*?)</script>', page, re.DOTALL)[1]


def decoded(page):
    """The page's data, read anew from the description in `studies.viewer.replay`."""
    head, data = json.loads(script(page, "head")), base64.b64decode(script(page, "data"))
    n, d, m, at, fields = head["n"], head["dim"], head["events"], 0, {}
    layout = [
        ("x", "f8", (n, d)), ("v", "f8", (n, d)), ("radii", "f8", (n,)), ("masses", "f8", (n,)),
        ("time", "f8", (m,)), ("push", "f8", (m, d)), ("i", "i4", (m,)), ("j", "i4", (m,)), ("species", "i4", (n,)),
    ]  # fmt: skip
    for name, kind, shape in layout:
        fields[name] = np.frombuffer(data, "<" + kind, np.prod(shape), at).reshape(shape)
        at += fields[name].nbytes
    assert at == len(data)
    return head, fields


def positions_from(head, data, moments):
    """Positions at increasing times: straight flights or parabolas between the events."""
    x, v, t, e = data["x"].copy(), data["v"].copy(), 0.0, 0
    box, periodic, out = np.array(head["box"]), np.array(head["periodic"]), []
    g = np.array(head.get("gravity", np.zeros(head["dim"])))
    for moment in moments:
        while e < head["events"] and data["time"][e] <= moment:
            x += (v + g * (data["time"][e] - t) / 2) * (data["time"][e] - t)
            v += g * (data["time"][e] - t)
            t, i, j = data["time"][e], data["i"][e], data["j"][e]
            v[i] += data["push"][e] / data["masses"][i]
            if j < head["n"]:
                v[j] -= data["push"][e] / data["masses"][j]
            e += 1
        now = x + (v + g * (moment - t) / 2) * (moment - t)
        out.append(np.where(periodic, now % box, now))
    return np.array(out)


def distance(scene, a, b):
    """Largest distance of two sets of positions along an axis, in the smallest diameter."""
    apart = np.asarray(a) - b
    apart -= np.where(scene.periodic, scene.box * np.round(apart / scene.box), 0.0)
    return np.max(np.abs(apart)) / (2 * scene.radii.min())


@pytest.fixture(scope="module")
def shown():
    """Of each kind: the replay, moments and the engine's positions at them."""
    known = {}

    def make(kind):
        if kind not in known:
            scene = gas(kind, **GASES[kind])
            replay = view(scene, 10)
            moments = np.linspace(0, replay.duration, MOMENTS + 1)[1:] * (1 - 1e-12)
            truth = [frame.positions for frame in hs.Simulation(scene).frames(times=moments)]
            known[kind] = replay, moments, np.array(truth)
        return known[kind]

    return make


@pytest.mark.parametrize("kind", KINDS)
def test_the_data_give_the_positions_of_the_engine(kind, shown):
    """Sibling: without the last momentum passed they do not."""
    replay, moments, truth = shown(kind)
    head, data = decoded(replay.html)
    assert distance(replay.scene, positions_from(head, data, moments), truth) < CLOSE
    assert replay.collisions == 10 * 40 / 2 and head["events"] == len(replay.events)
    assert (head["events"] > replay.collisions) == ("walls" in kind)
    data["push"] = np.where(np.arange(head["events"])[:, None] == head["events"] // 2, 0.0, data["push"])
    assert distance(replay.scene, positions_from(head, data, moments), truth) > 1e-3


def asked_of_node(tmp_path, replay, moments):
    """What the module computes at the moments, at them backwards, and stepping; temperatures and a2 at the start."""
    node = shutil.which("node")
    if node is None:
        pytest.skip("there is no node here")
    (tmp_path / "data").write_text(script(replay.html, "data"))
    program = f"""
import {{readFileSync}} from "node:fs";
import {{Gas, decode}} from {json.dumps(MODULE.as_uri())};
const gas = new Gas(decode({script(replay.html, "head")}, readFileSync("data", "utf8")));
const at = t => {{ gas.seek(t); return Array.from(gas.positionsNow()); }};
const moments = {json.dumps(list(moments))};
const out = {{kT: gas.temperatures(), a2: Array.from(gas.a2), s: Array.from(gas.s), thermal: gas.thermalA2()}};
out.forwards = moments.map(at);
out.backwards = moments.slice().reverse().map(at).reverse();
gas.seek(0);
out.there = []; while (gas.done < gas.events) {{ gas.next(); out.there.push([gas.t, gas.done]); }}
out.rule = gas.rule();
out.back = []; while (gas.done > 0) {{ out.back.push([gas.t, gas.done]); gas.previous(); }}
console.log(JSON.stringify(out));
"""
    (tmp_path / "ask.mjs").write_text(program)
    done = subprocess.run(
        [node, "ask.mjs"], cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.mark.parametrize("kind", KINDS)
def test_the_module_gives_the_same_positions_back_and_forth(kind, shown, tmp_path):
    replay, moments, truth = shown(kind)
    scene, out = replay.scene, asked_of_node(tmp_path, replay, moments)
    for way in ("forwards", "backwards"):
        assert distance(scene, np.reshape(out[way], truth.shape), truth) < CLOSE
    assert [done for _, done in out["there"]] == list(range(1, len(replay.events) + 1))
    assert out["back"] == out["there"][::-1]  # next and previous stop at the very moments
    assert [t for t, _ in out["there"]] == replay.events["time"].tolist()
    assert out["s"][-1] == pytest.approx(10)
    # Degrees of freedom: kT of all is that of the scene; a2 as in the estimators, about the mean square.
    freedom = [
        k["count"] * scene.dim - scene.periodic.sum() * k["count"] * k["mass"] / scene.masses.sum()
        for k in out["kT"]
    ]
    assert np.average([k["kT"] for k in out["kT"]], weights=freedom) == pytest.approx(
        scene.temperature, rel=1e-12
    )
    assert sum(freedom) == pytest.approx(scene.degrees_of_freedom)
    assert out["thermal"] == pytest.approx(equilibrium_a2(scene.degrees_of_freedom), rel=1e-12)
    drift = np.where(scene.periodic, scene.masses @ scene.velocities / scene.masses.sum(), 0.0)
    q = scene.masses * np.sum((scene.velocities - drift) ** 2, axis=1)
    assert out["a2"][0] == pytest.approx(
        scene.dim / (scene.dim + 2) * np.mean(q**2) / np.mean(q) ** 2 - 1, abs=1e-12
    )


def test_the_rule_conserves(shown, tmp_path):
    """Along the line of centres momentum and energy stay, across it nothing changes."""
    replay, moments, _ = shown("2d_mixture_walls")
    one, two = asked_of_node(tmp_path, replay, moments[:1])["rule"]["bodies"]
    m = replay.scene.masses
    for when in ("before", "after"):
        for body in (one, two):
            body["p" + when] = m[body["i"]] * body[when]["along"]
            body["e" + when] = m[body["i"]] * body[when]["along"] ** 2
    assert one["pbefore"] + two["pbefore"] == pytest.approx(one["pafter"] + two["pafter"])
    assert one["ebefore"] + two["ebefore"] == pytest.approx(one["eafter"] + two["eafter"])
    for body in (one, two):
        assert body["before"]["across"] == pytest.approx(body["after"]["across"], abs=1e-12)


# Gravity.


def falling(kind="2d_mixture_walls", gravity=(0.4, -2.0), **more):
    return gas(kind, **{"n": 30, "packing_fraction": 0.1} | more).replace(gravity=gravity)


def checked(replay, tmp_path):
    """Positions of the page against the engine's, from its data and by its module; and a2, kT of the module."""
    scene, moments = replay.scene, np.linspace(0, replay.duration, MOMENTS + 1)[1:] * (1 - 1e-12)
    frames = list(hs.Simulation(scene).frames(times=moments))
    truth = np.array([frame.positions for frame in frames])
    head, data = decoded(replay.html)
    assert head["gravity"] == scene.gravity.tolist()
    assert distance(scene, positions_from(head, data, moments), truth) < CLOSE
    # Sibling: in straight flights, or with the walls at other moments, they are elsewhere.
    assert (
        distance(
            scene, positions_from({**head, "gravity": [0.0, 0.0, 0.0][: scene.dim]}, data, moments), truth
        )
        > 1.0
    )
    out = asked_of_node(tmp_path, replay, moments)
    for way in ("forwards", "backwards"):
        assert distance(scene, np.reshape(out[way], truth.shape), truth) < CLOSE
    there = hs.Simulation(scene)
    there.run(collisions=replay.collisions)
    q = there.scene.masses * np.sum(there.velocities**2, axis=1)
    a2 = scene.dim / (scene.dim + 2) * np.mean(q**2) / np.mean(q) ** 2 - 1
    assert out["a2"][-1] == pytest.approx(a2, abs=1e-9)
    assert out["back"] == out["there"][::-1]
    return out


def test_parabolas_without_a_log(tmp_path):
    """Walls are hit between pair collisions, several times; towards a corner, from rest, and few that seldom meet."""
    for scene in (
        falling(),
        falling(gravity=(0.0, 3.0)),
        falling(n=6, packing_fraction=0.02, gravity=(0.0, -5.0)),
    ):
        replay = replay_by_steps(scene, 10)
        assert replay.collisions == 10 * scene.n / 2 and len(replay.events) > 1.2 * replay.collisions
        out = checked(replay, tmp_path)
        if scene.gravity[0] == 0.0:
            bodies = out["rule"]["bodies"]
            p = {
                when: sum(scene.masses[b["i"]] * b[when]["along"] for b in bodies)
                for when in ("before", "after")
            }
            assert p["before"] == pytest.approx(p["after"], abs=1e-9)
    still = falling().replace(velocities=np.zeros((30, 2)))
    checked(replay_by_steps(still, 4), tmp_path)


@pytest.mark.parametrize(
    "kind",
    [
        pytest.param("2d_mixture_walls", marks=pytest.mark.slow),
        pytest.param("3d_walls", marks=pytest.mark.long),
    ],
)
def test_parabolas_of_the_log_are_those_of_the_steps(kind, tmp_path):
    scene = falling(kind, gravity=(0.0, -2.0) if kind.startswith("2d") else (0.0, -2.0, 0.0))
    log, steps = view(scene, 10), replay_by_steps(scene, 10)
    checked(log, tmp_path)
    for name in ("i", "j"):
        assert log.events[name].tolist() == steps.events[name].tolist()
    for name in ("time", "impulse", "normal"):
        assert np.allclose(log.events[name], steps.events[name], rtol=1e-9, atol=1e-9)


# A simulation that goes on.


@pytest.mark.parametrize("kind", QUICK)
def test_a_logged_copy_goes_on_with_the_same_bits(kind):
    """Sibling: another simulation from the same positions has other bits; the original stays where it is."""
    sim = hs.Simulation(gas(kind, 40, 0.1))
    sim.run(collisions=500)
    was, events = everything(sim), []
    copy = sim.with_log(events.append)
    copy.run(collisions=300)
    assert everything(sim) == was
    log = np.concatenate(events)
    sim.run(collisions=300)
    for name in ("time", "collisions", "wall_collisions"):
        assert getattr(copy, name) == getattr(sim, name)
    for name in ("positions", "unwrapped_positions", "velocities"):
        assert getattr(copy, name).tobytes() == getattr(sim, name).tobytes()
    for name in ("time", "virial", "kinetic", "wall_impulses", "wall_radius_impulses"):
        assert (
            np.asarray(getattr(copy.tallies, name)).tobytes()
            == np.asarray(getattr(sim.tallies, name)).tobytes()
        )
    assert np.sum(log["j"] < 40) == 300 and log["time"][-1] == sim.time
    copy.check()
    fresh = hs.Simulation(was_scene := hs.Simulation(gas(kind, 40, 0.1)).to_scene())
    fresh.run(collisions=300)
    assert was_scene.n == 40 and fresh.positions.tobytes() != sim.positions.tobytes()


def test_a_simulation_is_shown_from_now_on():
    sim = hs.Simulation(gas("3d", 40, 0.1))
    sim.run(collisions=100)
    replay, began = view(sim, 2), sim.time
    head, data = decoded(replay.html)
    assert replay.collisions == 40 and sim.collisions == 100
    sim.run(collisions=30)
    assert distance(replay.scene, positions_from(head, data, [sim.time - began])[0], sim.positions) < CLOSE


# The gas that thermalise leaves to be watched.


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"dim": 2, "boundary": "wall", "mass_ratio": 7.0, "diameter_ratio": 0.6, "packing_fraction": 0.2},
        {"packing_fraction": 0.3, "velocities": "beams"},
    ],
)
def test_a_small_gas_of_the_kind_without_other_kernels(options, monkeypatch):
    """Same dimension, walls, species, density and start; sibling: a log has kernels of its own."""
    kernels, specialise = [], hardspheres.kernel.specialise
    monkeypatch.setattr(
        hardspheres.kernel, "specialise", lambda *kind: kernels.append(kind) or specialise(*kind)
    )
    study = Thermalisation(seed=5, **options)
    gas = study.gases()[0]
    study.start(gas, np.random.SeedSequence(5, spawn_key=(0,)))
    replay = study.replay()
    assert kernels[0] == kernels[1] and len(kernels) == 2
    hs.Simulation(replay.scene, log=print)
    assert kernels[2] != kernels[0]
    small = replace(gas, n=400).scene(np.random.SeedSequence(5, spawn_key=(0,)))
    assert replay.scene.positions.tobytes() == small.positions.tobytes()
    assert replay.scene.velocities.tobytes() == small.velocities.tobytes()
    assert replay.collisions == 2000 and len(replay.html) < 300_000
    assert study.replay().html == replay.html != replace(study, seed=6).replay().html


def test_of_few_all_are_watched_and_of_a_large_file_none():
    few, many = gas("3d", 40, 0.1), gas("3d", 900, 0.01)
    assert Thermalisation(n=30).replay().scene.n == 30
    study = Thermalisation(source="few.xyz", structure=few)
    assert study.replay().scene.velocities.tobytes() == few.velocities.tobytes()
    assert Thermalisation(source="many.xyz", structure=many).replay() is None
    assert Thermalisation(n=1).replay() is None  # it never collides


# The page.

RIGHT, LEFT = "\ue014", "\ue012"  # arrow keys, as the driver names them
PAGE = (MODULE.parent / "page.html").read_text(encoding="utf-8")


def colours(rules):
    """Colours of a block of CSS variables, as relative luminances (WCAG 2)."""
    found = {}
    for name, text in re.findall(r"--(\w+): #([0-9a-f]{6}|[0-9a-f]{3})[;\s]", rules):
        text = text if len(text) == 6 else "".join(2 * digit for digit in text)
        c = np.array([int(text[k : k + 2], 16) / 255 for k in (0, 2, 4)])
        found[name] = np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4) @ [
            0.2126,
            0.7152,
            0.0722,
        ]
    return found


def contrast(a, b):
    return (max(a, b) + 0.05) / (min(a, b) + 0.05)


def test_text_stands_out_light_and_dark():
    """WCAG 2: 4.5 for text, 3 for borders. Sibling: grey on the panel would not do."""
    blocks = re.findall(r":root \{(.*?)\}", PAGE, re.DOTALL)
    assert len(blocks) == 2
    for block in blocks:
        c = colours(block)
        for text, ground in (("ink", "paper"), ("ink", "panel"), ("paper", "accent")):
            assert contrast(c[text], c[ground]) >= 4.5, (text, ground)
        assert contrast(c["faint"], c["paper"]) >= 3 and contrast(c["accent"], c["panel"]) >= 3
    grey = colours("--grey: #9aa4b2;")["grey"]
    assert contrast(grey, colours(blocks[0])["panel"]) < 4.5


def test_each_key_is_told_and_each_control_has_a_name():
    keys = re.search(r"const keys = \{(.*?)\}", MODULE.read_text(encoding="utf-8"), re.DOTALL)[1]
    words = {" ": "Space", "ArrowRight": "Right", "ArrowLeft": "left", "-": "−", "=": "+"}  # = is + unshifted
    told = " ".join(re.findall(r"<dt>(.*?)</dt>", PAGE)).split()
    named = re.findall(r'"([^"]+)": "\w+"|\b(\w+): "\w+"', keys)
    assert len(named) == 9
    for key in map("".join, named):
        assert words.get(key, key) in told, key
    buttons = re.findall(r"<button([^>]*)>(.*?)</button>", PAGE)
    assert len(buttons) == 9 and all(
        re.search("[a-z]", text) or "aria-label" in more for more, text in buttons
    )
    for tag in re.findall(r"<(?:canvas|input|nav)[^>]*>", PAGE):
        assert "aria-label" in tag, tag
    assert '<html lang="en">' in PAGE


def test_the_title_says_which_gas(shown):
    page = shown("2d_mixture_walls")[0].html
    told = "40 hard discs of two species, wall box, packing fraction 0.2"
    assert f"<title>{told}</title>" in page and f"<h1>{told}</h1>" in page


def test_labels_go_along(shown):
    """Sibling: where all are the same, or there are none, there is nothing to tell apart."""
    replay = shown("3d")[0]
    labels = np.arange(40) % 3 * 5 - 5
    page = replace(replay, scene=replay.scene.replace(labels=labels)).html
    head, data = json.loads(script(page, "head")), base64.b64decode(script(page, "data"))
    plain = base64.b64decode(script(replay.html, "data"))
    assert head["labels"] == [-5, 0, 5] and data[: len(plain)] == plain
    assert np.array_equal(np.frombuffer(data[len(plain) :], "<i4"), np.arange(40) % 3)
    assert view(replay.scene.replace(labels=labels), 1)._head()["labels"] == [-5, 0, 5]  # through a run
    for same in (None, np.zeros(40, dtype=int)):
        assert replace(replay, scene=replay.scene.replace(labels=same)).html == replay.html


@pytest.mark.parametrize("kind", QUICK)
def test_steps_see_the_events_of_a_log(kind):
    """Sibling: without the hits of walls between two collisions there are fewer."""
    scene = gas(kind, 40, 0.2)
    log, steps = view(scene, 10).events, replay_by_steps(scene, 10).events
    assert np.array_equal(log["i"], steps["i"]) and np.array_equal(log["j"], steps["j"])
    for name in ("time", "normal", "impulse"):
        assert np.allclose(log[name], steps[name], rtol=0, atol=1e-12)
    assert (np.sum(steps["j"] < 40) < len(steps)) == ("walls" in kind)


def obstacle():
    """Return a heavy moving one, and a light particle that meets it."""
    positions, velocities = [[1, 1, 1], [2.4, 1.1, 1]], [[0, 1, 0], [-1, 1, 0]]
    return hs.Scene(positions, velocities, masses=[1e18, 1], radii=[0.5, 0.3], box=[3, 3, 3])


def test_steps_that_change_nothing_are_left_to_a_log():
    """A velocity of 1 does not change where 1e-18 is added."""
    replay = replay_by_steps(obstacle(), 3)
    assert replay.collisions == 3 and not np.any(np.isnan(replay.events["normal"]))


def test_an_obstacle_has_no_temperature(tmp_path):
    """It has all of the mass, and so no degree of freedom beside the drift."""
    kinds = asked_of_node(tmp_path, view(obstacle(), 3), [0.1])["kT"]
    assert {kind["mass"]: kind["kT"] for kind in kinds} == {1e18: 0, 1: pytest.approx(1 / 3)}


@pytest.mark.slow
def test_obstacles_stay_and_count_in_no_sum(tmp_path):
    """Obstacles of infinite mass, two of which overlap: flights end at them, and nothing of theirs is a number."""
    scene = hs.Scene(
        [[2, 2], [2.5, 2], [7, 7], [5, 5], [8, 3]],
        [[0, 0], [0, 0], [0, 0], [1, 0.3], [-0.4, 0.8]],
        radii=[0.5, 0.5, 1.0, 0.3, 0.3],
        masses=[np.inf, np.inf, np.inf, 1, 1],
        box=(10, 10),
        boundary="wall",
    )
    replay = view(scene, 6)
    out = asked_of_node(tmp_path, replay, [0.0, 0.7 * replay.duration])
    there = hs.Simulation(scene)
    there.run(time=0.7 * replay.duration)
    assert np.abs(np.reshape(out["forwards"][1], (5, 2)) - there.positions).max() < 1e-9
    assert out["s"][-1] >= 6 and np.isfinite(out["a2"]).all()
    energies = np.sum(scene.velocities[3:] ** 2, axis=1)
    assert out["a2"][0] == pytest.approx(0.5 * np.mean(energies**2) / np.mean(energies) ** 2 - 1)
    assert [kind["kT"] for kind in out["kT"]] == [0, pytest.approx(scene.temperature)]
    assert out["thermal"] == pytest.approx(-2 / (scene.degrees_of_freedom + 2))


def among_pins(moment):
    """A disc that has left a pin twice under gravity, the page of it by hand, and where it is at a moment.

    The log that pages are made from has a kernel of its own; a ball above a pin needs none.
    """
    scene = hs.Scene(
        [[5.0, 3.0], [5.0, 4.5]],
        [[0, 0], [0, 0]],
        [0.75, 0.25],
        [np.inf, 3.0],
        (10, 10),
        "wall",
        gravity=(0, -1),
    )
    events = np.zeros(2, event_dtype(2))
    events["time"], events["i"], events["j"] = [1.0, 3.0], 0, 1
    events["impulse"], events["normal"], events["free_path"] = 6.0, [0.0, -1.0], np.nan
    since = (moment + 1.0) % 2.0 - 1.0
    return Replay(scene, events, 3.0), [5.0, 4.5 - since**2 / 2]


def test_obstacles_do_not_fall_in_the_page(tmp_path):
    """Before the first event, between the two and at the end, where a pin that fell would be 4.5 lower."""
    for moment in (0.5, 2.5, 3.0):
        replay, there = among_pins(moment)
        out = asked_of_node(tmp_path, replay, [moment])
        assert np.allclose(np.reshape(out["forwards"][0], (2, 2)), [[5.0, 3.0], there], rtol=0, atol=1e-12)
        assert np.isfinite(out["a2"]).all()


@pytest.mark.slow
def test_a_galton_board_is_shown_as_it_was_run(tmp_path):
    pins = [(k, y) for y in range(2, 5) for k in range(1 + y % 2, 12, 2)]
    n = len(pins) + 2
    scene = hs.Scene(
        [*pins, (5.2, 8), (6.9, 7)], np.zeros((n, 2)), [0.3] * (n - 2) + [0.2, 0.25], [np.inf] * (n - 2) + [1, 2],
        (12, 10), "wall", gravity=(0, -1),
    )  # fmt: skip
    replay = replay_by_steps(scene, 8)
    moments = np.linspace(0.1, 1.0, 4) * replay.duration * (1 - 1e-12)
    out = asked_of_node(tmp_path, replay, moments)
    truth = [frame.positions for frame in hs.Simulation(scene).frames(times=moments)]
    assert np.abs(np.reshape(out["forwards"], (4, n, 2)) - truth).max() < 1e-8


def test_a_thousand_spheres_with_twenty_collisions_are_under_a_megabyte():
    """From bytes for each particle and event of a small page, without running the large one."""
    page, n, s = view(gas("3d", 40, 0.1), 2), 1000, 20
    one = len(page._data())
    per_event = 8 + 3 * 8 + 2 * 4
    assert one == 40 * (2 * 3 * 8 + 2 * 8 + 4) + len(page.events) * per_event
    frame = len(page.html) - len(script(page.html, "data"))
    whole = frame + 4 / 3 * (n * (2 * 3 * 8 + 2 * 8 + 4) + n * s / 2 * per_event)
    assert 30 <= per_event <= 40 and whole < 1e6


def test_the_page_needs_no_network(shown, tmp_path):
    replay = shown("3d")[0]
    replay.save(tmp_path / "gas.html")
    page = (tmp_path / "gas.html").read_text(encoding="utf-8")
    assert page == replay.html and [path.name for path in tmp_path.iterdir()] == ["gas.html"]
    assert not re.findall(
        r"https?://|@import|<link (?!rel=\"icon\" href=\"data:)|src=|\bimport\b.*from", page
    )
    assert "@HEAD@" not in page and "@MODULE@" not in page
    assert replay._repr_html_().count("<iframe") == 1 and "Replay of" in repr(replay)


def refusals(tmp_path):
    scene = gas("3d", 40, 0.1)
    yield lambda: view("gas"), "view takes a Scene or a Simulation, not 'gas'"
    yield lambda: view(scene, 0), "collisions_per_particle is 0; it must be above 0 and at most 1000"
    yield lambda: view(scene, "many"), "collisions_per_particle is 'many'; it must be above 0"
    yield lambda: view(scene, float("nan")), "collisions_per_particle is nan; it must be above 0"
    yield lambda: view(gas("3d", 1, 0.01)), "no collision is to come: there is one particle only"
    yield lambda: view(scene, 1).save(tmp_path / "gas.txt"), "must end in .html"
    yield (
        lambda: view(scene, 1).save(tmp_path / "no" / "gas.html"),
        "cannot be written: No such file or directory",
    )


def test_each_refusal_is_one_sentence(tmp_path, monkeypatch):
    for refused, sentence in refusals(tmp_path):
        with pytest.raises(hs.HardSpheresError) as told:
            refused()
        assert sentence in str(told.value) and "\n" not in str(told.value), str(told.value)
    monkeypatch.setattr(replays, "MOST_PARTICLES", 39)
    with pytest.raises(
        hs.SimulationError, match="shows up to 39 particles, and this gas has 40; show a smaller one"
    ):
        view(gas("3d", 40, 0.1))
    monkeypatch.setattr(replays, "MOST_PARTICLES", 40)
    monkeypatch.setattr(replays, "MOST_EVENTS", 50)
    with pytest.raises(hs.SimulationError, match="up to 50 events.*fewer collisions per particle: below 2,"):
        view(gas("3d", 40, 0.1))
    with pytest.raises(hs.SimulationError, match="up to 50 events"):  # walls: only the run tells
        view(gas("2d_mixture_walls", 40, 0.1), 2.4)
    assert not list(tmp_path.iterdir())


# The command.


def command(monkeypatch, *options):
    monkeypatch.setattr(sys, "argv", ["hardspheres", "view", *map(str, options)])
    with pytest.raises(SystemExit) as end:
        main()
    return end.value.code


@pytest.fixture
def trajectory(tmp_path):
    sim = hs.Simulation(gas("3d", 40, 0.1))
    with hs.TrajectoryWriter(tmp_path / "own.xyz") as out:
        for frame in sim.frames(every=1.0, count=2):
            out.write(frame)
    sim.save(tmp_path / "own.npz")
    return tmp_path


@pytest.mark.parametrize("file", ["own.xyz", "own.npz"])
def test_a_file_becomes_a_page(file, trajectory, monkeypatch, capsys):
    monkeypatch.chdir(trajectory)
    assert not command(monkeypatch, file, "--out", "new/gas.html", "--collisions-per-particle", 2)
    assert "40 collisions of 40 particles: new/gas.html, 0.0" in capsys.readouterr().out.replace("\n", " ")
    head, data = decoded((trajectory / "new" / "gas.html").read_text(encoding="utf-8"))
    start = next(hs.read_trajectory("own.xyz")) if file == "own.xyz" else hs.Simulation.load(file).to_scene()
    assert np.array_equal(data["x"], start.positions) and head["n"] == 40
    assert command(monkeypatch, file, "--out", "new/gas.html") == 2
    assert (
        "new/gas.html exists; give another name with --out, or --force to replace it"
        in capsys.readouterr().err
    )
    assert not command(monkeypatch, file, "--out", "new/gas.html", "--force", "--collisions-per-particle", 1)


OWN = """2
Lattice="9 0 0 0 9 0 0 0 9" Properties=species:S:1:pos:R:3:vel:R:3 pbc="T T T"
A 2 2 0 0 1 0
B 5 5 0 1 0 0
"""


def test_the_options_of_foreign_files(tmp_path, monkeypatch):
    """Sibling: without each of them the file is refused, or read as something else."""
    monkeypatch.chdir(tmp_path)
    Path("foreign.xyz").write_text(OWN)
    given = {"radius": {"A": 0.5, "B": 0.3}, "velocities_are": "reduced", "dim": 2, "mass": {"A": 7, "B": 2}}
    read = {}
    for left_out in (None, *given):
        view_of = View(file="foreign.xyz", **{name: each for name, each in given.items() if name != left_out})
        try:
            scene = view_of._start()
            read[left_out] = scene.dim, scene.radii.tolist(), scene.masses.tolist()
        except hs.HardSpheresError as error:
            read[left_out] = left_out.replace("_", "-") in str(error)
    assert read == {
        None: (2, [0.5, 0.3], [7, 2]),
        "radius": True,
        "velocities_are": True,
        "dim": (3, [0.5, 0.3], [7, 2]),
        "mass": (2, [0.5, 0.3], [1, 1]),
    }


def test_bad_input_is_one_sentence(trajectory, monkeypatch, capsys):
    monkeypatch.chdir(trajectory)
    (trajectory / "folder.html").mkdir()
    for name, scene in {
        "rest": hs.Scene([[1, 1, 1]], [[0, 0, 0]], box=[3, 3, 3]),
        "one": hs.Scene([[1, 1, 1]], [[1, 0, 0]], box=[3, 3, 3], boundary="wall"),
        "still": hs.Scene([[1, 1, 1], [2, 2, 2]], np.ones((2, 3)), box=[3, 3, 3]),
    }.items():
        with hs.TrajectoryWriter(f"{name}.xyz") as out:
            out.write(hs.Simulation(scene).frame())
    for options, sentence in [
        (["missing.xyz", "--out", "gas.html"], "missing.xyz"),
        (["missing.npz", "--out", "gas.html"], "missing.npz"),
        (["own.xyz", "--out", "gas.txt"], "--out gas.txt must end in .html: it is a page for a browser"),
        (
            ["own.xyz", "--out", "folder.html"],
            "folder.html is a folder; give the page another name with --out",
        ),
        (["own.xyz", "--out", "own.npz/gas.html"], "own.npz exists and is not a folder"),
        (
            ["own.npz", "--radius", "1", "--dim", "3"],
            "own.npz is a checkpoint, which has everything; leave out --radius, --dim\n",
        ),
        (["rest.xyz"], "rest.xyz is at rest: no frame has velocities; give a file that has them\n"),
        (["one.xyz"], "no collision is to come: there is one particle only\n"),
        (["still.xyz"], "no particle moves relative to another; give them velocities\n"),
        (
            ["own.xyz", "--collisions-per-particle", "-1"],
            "collisions_per_particle is -1.0; it must be above 0",
        ),
    ]:
        assert command(monkeypatch, *options) == 2
        told = capsys.readouterr().err
        assert told.startswith("error: ") and sentence in told and told.count("\n") == 1, told
    assert not list(trajectory.glob("gas*")) and list((trajectory / "folder.html").iterdir()) == []


# In a browser.

in_a_browser = pytest.mark.skipif(bool(chromium.missing()), reason=chromium.missing() or "there is a browser")
CENTRE = """const r = document.getElementById('%s').getBoundingClientRect();
    return [r.x + r.width / 2, r.y + r.height / 2];"""
PIXELS = """const c = document.getElementById("%s"), copy = new OffscreenCanvas(c.width, c.height),
    g = copy.getContext("2d", {willReadFrequently: true}); g.drawImage(c, 0, 0);
    const data = g.getImageData(0, 0, c.width, c.height).data; """
STATE = """return [replay.gas.done, replay.shown, replay.playing, replay.direction,
    document.getElementById('manual').open];"""


@pytest.fixture(scope="module")
def window():
    with chromium.browser() as opened:
        yield opened


@pytest.fixture
def still(window):
    """The browser, for a reader who wants no motion; at the end no page has complained."""
    window.media()
    yield window
    assert window.messages() == []


@pytest.mark.slow
@in_a_browser
@pytest.mark.parametrize("kind", ["3d", "2d"])
def test_the_page_in_a_browser(kind, shown, tmp_path, still):
    replay, moments, truth = shown(kind)
    replay.save(tmp_path / "gas.html")
    still.open(tmp_path / "gas.html", 1200, 900)
    ask = "const g = replay.gas; return %s.map(t => { g.seek(t); return Array.from(g.positionsNow()); });"
    for way in (1, -1):
        seen = still.run(ask % json.dumps(moments[::way].tolist()))
        assert distance(replay.scene, np.reshape(seen, truth.shape)[::way], truth) < CLOSE
    still.run("replay.gas.seek(0);")
    drawn = PIXELS % "rule" + "return data.some(x => x > 0);"
    assert not still.run(drawn)
    still.press(RIGHT)
    still.frame()
    assert still.run(drawn)  # at the first step already
    still.press(RIGHT)
    assert still.run(STATE) == [2, True, False, 1, False]
    still.press(LEFT)
    assert still.run(STATE) == [1, True, False, 1, False]
    still.press("?")
    assert still.run(STATE)[4] is True
    still.press(RIGHT)  # not behind the help
    assert still.run(STATE)[0] == 1
    still.press("?")
    still.press(" ")
    assert still.run(STATE)[2:] == [True, 1, False]
    still.press(" ")
    assert still.run(STATE)[2] is False
    still.press("r")
    assert still.run(STATE)[3] == -1
    still.run("replay.gas.seek(0);")
    for key, button in ((" ", "previous"), (RIGHT, "next"), (LEFT, "slider")):  # a button that has the focus
        still.run(f"document.getElementById('{button}').focus();")
        still.press(key)
    assert still.run(STATE)[:3] == [0, False, False]
    still.click(*still.run(CENTRE % "next"))
    still.press(" ")  # plays: a clicked button does not keep the focus
    assert still.run(STATE)[2] is True


@pytest.mark.slow
@in_a_browser
def test_a_finger_and_a_mouse(shown, tmp_path, still):
    """On a phone: nothing wider than it, buttons of 40 pixels, the box turned and the cursor dragged."""
    shown("3d")[0].save(tmp_path / "gas.html")
    for width, touch, drag in ((400, True, still.finger), (1200, False, lambda a, b: still.click(*a, b))):
        still.open(tmp_path / "gas.html", width, 800, touch=touch)
        still.frame()
        assert still.run("return document.documentElement.scrollWidth;") == width
        sizes = still.run("""return Array.from(document.querySelectorAll("nav button, #slider"),
            b => b.getBoundingClientRect()).filter(r => r.width).map(r => Math.min(r.width, r.height));""")
        assert len(sizes) == 8 and min(sizes) >= 40
        turned = still.run("return replay.turned;")
        x, y = still.run(CENTRE % "gas")
        drag((x, y), (x + 50, y - 20))
        assert still.run("return replay.turned;") == pytest.approx([turned[0] + 0.4, turned[1] + 0.16])
        still.run("document.getElementById('course').scrollIntoView();")
        x, y = still.run(CENTRE % "course")
        drag((x, y), (x + 50, y))
        assert 0.5 < still.run("return replay.gas.s[replay.gas.done] / 10;") < 0.8
        drag((x, y), (x - 500, y))
        assert still.run("return replay.gas.done;") == 0


@pytest.mark.slow
@in_a_browser
def test_light_dark_and_paper(shown, tmp_path, still):
    """The canvases change colours at once; paper is light whatever the screen is."""
    shown("2d")[0].save(tmp_path / "gas.html")
    still.open(tmp_path / "gas.html", 1200, 900)
    # the commonest grey: text and curve
    ink = (
        PIXELS % "speeds"
        + """const seen = new Map();
        for (let k = 0; k < data.length; k += 4) if (data[k + 3] === 255 && Math.abs(data[k] - data[k + 2]) < 25)
          seen.set(data[k], (seen.get(data[k]) || 0) + 1);
        return [...seen].sort((a, b) => b[1] - a[1])[0][0];"""
    )
    seen = []
    for kind, scheme in (("", "light"), ("", "dark"), ("print", "dark"), ("", "dark")):
        still.media(kind, scheme)
        still.frame()
        seen.append(still.run(ink))
    assert seen[0] < 60 and seen[1] > 200 and seen[2] < 60 and seen[3] == seen[1], seen


@pytest.mark.slow
@in_a_browser
def test_it_moves_by_itself_unless_that_is_unwanted(shown, tmp_path, still):
    shown("3d")[0].save(tmp_path / "gas.html")
    for motion, moves in (("no-preference", True), ("reduce", False)):
        still.media(motion=motion)
        still.open(tmp_path / "gas.html", 1200, 900)
        still.frame()
        assert still.run("return [replay.playing, replay.gas.t > 0];") == [moves, moves]


@pytest.mark.slow
@in_a_browser
@pytest.mark.parametrize("box", ["", " sandbox='allow-scripts'", " name='play'"])
def test_in_a_notebook_it_waits_until_it_is_clicked(box, shown, tmp_path, still):
    """It does not play by itself, and takes no keys of the page around it before a click.

    Sibling: in a frame called "play", which was asked for, it plays.
    """
    frame = shown("3d")[0]._repr_html_().replace("<iframe", f"<iframe{box} onload='this.ready = true'")
    told = """<script>addEventListener("message", e => { told.push(e.data); }); const told = [];</script>"""
    spy = "<script>setInterval(() => parent.postMessage([replay.playing, replay.gas.done], '*'), 20)</script>"
    frame = frame.replace("&lt;/body&gt;", f"{html.escape(spy)}&lt;/body&gt;")
    (tmp_path / "note.html").write_text(f"<!doctype html><meta charset=utf-8>{told}{frame}")
    still.media(motion="no-preference")
    still.open(tmp_path / "note.html", 900, 900)
    wait = "const end = arguments[0]; told.length = 0; const k = setInterval(() => { if (told.length > 2) { clearInterval(k); end(told[told.length - 1]); } }, 20);"

    def state():
        return still.call("POST", "/execute/async", {"script": wait, "args": []})

    if "play" in box:
        assert state()[0] is True
        return
    still.press(RIGHT)
    assert state() == [False, 0]
    still.click(300, 200)
    still.press(RIGHT)
    still.press(RIGHT)
    assert state() == [False, 2]
    still.press(" ")
    assert state()[0] is True
