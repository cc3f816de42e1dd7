"""Values in files: back to the last bit, nothing executed, nothing unknown taken."""

import math
import sys
from collections import deque
from dataclasses import dataclass
from types import ModuleType

import numpy as np
import pytest

import hardspheres as hs
from analysis.estimator import Estimator
from analysis.pressure import Pressure
from analysis.relaxation import RelaxationCurve
from analysis.series import BlockSeries
from analysis.statistics import Estimate
from analysis.theory import Prediction
from analysis.transport import Diffusion
from hardspheres.archive import read_archive, write_archive
from hardspheres.errors import CheckpointError
from studies.fluid import Fluid
from studies.running.encoding import decode, encode, read, write


def again(value):
    return decode(encode(value))


@pytest.mark.parametrize(
    "value",
    [
        None,
        True,
        -(2**70),
        0.1,
        -0.0,
        math.inf,
        "µ",
        [1, (2.0, [None])],
        {"a": 1, 2: {"b": ()}},
        Estimate(1.5, 0.1, 7.0),
        Prediction(math.nan, 0.0),
        Fluid(n=10, boundary=("wall", "periodic", "wall")),
    ],
)
def test_plain_values_come_back(value):
    found = again(value)
    assert type(found) is type(value) and repr(found) == repr(value)


@pytest.mark.parametrize(
    "array",
    [
        np.arange(6.0).reshape(2, 3),
        np.asfortranarray(np.arange(6.0).reshape(2, 3)),
        np.arange(12, dtype=np.uint32)[::3],
        np.zeros((0, 3), dtype=np.float32),
        np.array([True, False]),
        np.array(3, dtype=np.int64),
        np.array([math.nan, -0.0]),
    ],
)
def test_arrays_come_back_bit_by_bit_and_can_be_changed(array):
    found = again(array)
    assert found.dtype == array.dtype and found.shape == array.shape and found.tobytes() == array.tobytes()
    assert found.flags.f_contiguous == array.flags.f_contiguous or not array.flags.contiguous
    assert found.flags.writeable


def test_scalars_queues_and_shared_arrays_keep_their_nature():
    shared = np.arange(3.0)
    found = again([np.float64(1 / 3), np.int32(4), deque([shared, shared], maxlen=2), (shared,)])
    assert type(found[0]) is np.float64 and type(found[1]) is np.int32 and found[0] == 1 / 3
    queue = found[2]
    assert queue.maxlen == 2 and queue[0] is queue[1] is found[3][0]


def test_a_simulation_and_its_estimators_go_on_with_the_same_bits():
    sim = hs.Simulation(hs.random_gas(n=100, packing_fraction=0.3, seed=1))
    curve, pressure, diffusion = RelaxationCurve(), Pressure(sim.scene, discard=True), Diffusion(4)

    def advance(sim, curve, pressure, diffusion, rounds):
        for _ in range(rounds):
            sim.run(time=0.2)
            curve.add(sim.frame())
            pressure.add(sim.frame())
            diffusion.add(sim)
        return [sim, curve, pressure, diffusion]

    state = advance(sim, curve, pressure, diffusion, 21)
    other = advance(*again(state), 23)
    state = advance(*state, 23)
    assert other[0].positions.tobytes() == sim.positions.tobytes()
    for mine, theirs in zip(state[1:], other[1:], strict=True):
        assert encode(mine)["data"].tobytes() == encode(theirs)["data"].tobytes()
        assert encode(mine)["tree"].tobytes() == encode(theirs)["tree"].tobytes()
    assert not other[2].scene.positions.flags.writeable


def test_a_file_is_sealed(tmp_path):
    path = tmp_path / "value.npz"
    write(path, {"x": np.arange(5.0)})
    assert read(path)["x"].tolist() == [0, 1, 2, 3, 4]
    whole = path.read_bytes()
    for place in range(0, len(whole), 37):
        path.write_bytes(whole[:place] + bytes([whole[place] ^ 4]) + whole[place + 1 :])
        with pytest.raises(CheckpointError):
            read(path)
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(CheckpointError, match="value.npz"):
        read(path)


@dataclass
class Foreign:
    x: int = 1


class Own(Estimator):
    """Somebody's estimator, in a module of theirs."""

    def __init__(self, edges):
        self.edges, self.seen = np.array(edges), []

    def add(self, frame):
        self.seen.append(frame)
        return self

    checks = ()

    def _take_in(self, other):
        self.seen += other.seen

    def plot(self, ax=None):
        raise NotImplementedError


@dataclass
class OwnWithFields(Own):
    first: int = 3

    def __post_init__(self):
        super().__init__([1.0])


class Slotted(Own):
    """Keeps something where `vars` does not show it."""

    __slots__ = ("hidden",)


def test_estimators_of_ones_own_are_stored(monkeypatch):
    """All that they know, fields or not; siblings: read where their module is not loaded, or knows another of the name."""
    members = encode([Own([1.0, 2.0]).add(3), OwnWithFields().add(4)])
    one, other = decode(members)
    assert type(one) is Own and one.edges.tolist() == [1.0, 2.0] and one.seen == [3]
    assert type(other) is OwnWithFields and other.first == 3 and other.seen == [4]
    for change in (
        lambda patch: patch.delitem(sys.modules, __name__),
        lambda patch: patch.setattr(sys.modules[__name__], "Own", Foreign),
    ):
        with monkeypatch.context() as patch:
            change(patch)
            with pytest.raises(CheckpointError, match="Own', which is no class that is stored here"):
                decode(members)


def test_what_a_worker_has_stored_of_a_script_its_parent_reads(monkeypatch):
    """A class of a script is of __mp_main__ in a worker and of __main__ in the parent."""
    script = ModuleType("__main__")
    monkeypatch.setitem(sys.modules, "__main__", script)
    for writer, reader in (("__mp_main__", "__main__"), ("__main__", "__mp_main__")):
        script.Own = type("Own", (Own,), {"__module__": writer})
        members = encode(script.Own([1.0]))
        script.Own = type("Own", (Own,), {"__module__": reader})
        assert type(decode(members)) is script.Own


OF_NOBODY = type("Local", (Own,), {"__qualname__": "function.<locals>.Local"})([1.0])


@pytest.mark.parametrize(
    "value",
    [Foreign(), object(), {1}, np.array([None]), lambda: None, 1j, Slotted([1.0]), OF_NOBODY],
)
def test_what_is_not_ours_is_not_stored(value):
    with pytest.raises(TypeError, match="cannot be stored") as caught:
        encode(value)
    assert isinstance(caught.value, CheckpointError)  # so that a study of one's own says so in a sentence


@pytest.mark.parametrize(
    ("tree", "sentence"),
    [
        ('{"object": ["subprocess.Popen", {"args": {"list": ["true"]}}]}', "no class that is stored here"),
        ('{"object": ["hardspheres.simulation.Simulation", {}]}', "no class that is stored here"),
        ('{"object": ["studies.absent.Nothing", {}]}', "no class that is stored here"),
        (f'{{"object": ["{__name__}.Foreign", {{"x": 1}}]}}', "no class that is stored here"),
        (f'{{"object": ["{__name__}.Slotted", {{}}]}}', "no class that is stored here"),
        ('{"object": ["analysis.statistics.Estimate", {"value": 1}]}', "of another version"),
        ('{"lambda": 1}', "'lambda', which this version does not know"),
        ('{"array": 7}', "IndexError"),
        ("[1]", "AttributeError"),
        ("[" * 100_000, "cannot be understood"),
    ],
)
def test_a_crafted_file_is_refused_and_executes_nothing(tree, sentence, tmp_path):
    whole = f'{{"tree": {tree}, "arrays": []}}'.encode()
    members = {"tree": np.frombuffer(whole, dtype=np.uint8), "data": np.zeros(0, dtype=np.uint8)}
    path = tmp_path / "crafted.npz"
    write_archive(path, members)
    read_archive(path)  # the first archive that a process reads loads a codec
    before = set(sys.modules)
    with pytest.raises(CheckpointError, match=sentence):
        read(path)
    assert set(sys.modules) == before
    assert set(read_archive(path)) == {"tree", "data"}


def test_arrays_of_objects_and_sizes_that_are_not_there_are_refused():
    for described in ('["|O", [1], false]', '["<f8", [1000000000000], false]', '["<f8", [-1], false]'):
        whole = f'{{"tree": {{"array": 0}}, "arrays": [{described}]}}'.encode()
        with pytest.raises(CheckpointError):
            decode({"tree": np.frombuffer(whole, dtype=np.uint8), "data": np.zeros(8, dtype=np.uint8)})


def test_a_series_of_blocks_goes_on():
    series = BlockSeries(16)
    for k in range(37):
        series.add([k, 1.0])
    other = again(series)
    for k in range(50):
        series.add([k, 2.0])
        other.add([k, 2.0])
    assert other.rows.tobytes() == series.rows.tobytes() and other.n_samples == series.n_samples
