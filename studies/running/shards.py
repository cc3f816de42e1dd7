"""Shards: processes that each run their part of a study into one folder, for batch systems.

    DIR/checkpoint/shard-0002-1a2b3c4d  where shard 2 runs, see `studies.running.presence`
    DIR/checkpoint/claim-0007           the name of the file above of the shard that runs item 7

A claim is as good as its shard's presence: when the shard has ended, however it did, another process may take
the item over, from its last state. Claims save work, and results do not depend on them: two processes that
run the same item find the same, and one whose claim was taken over stores nothing any more.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hardspheres.temporary import placing, replacing
from studies.options import OptionError
from studies.running.ensemble import run_replicas
from studies.running.journal import Shelf, not_written
from studies.running.presence import NAMED, Presence
from studies.running.resuming import perform

if TYPE_CHECKING:
    from studies.report import Screen

__all__ = ["Shard", "SharedShelf", "run_part"]


@dataclass(frozen=True)
class Shard:
    """Which part of a study: every `count`-th of its items, from the `number`-th on.

    Attributes
    ----------
    number, count : int
        From 1.
    """

    number: int
    count: int

    @classmethod
    def parsed(cls, text: str) -> Shard:
        """Return the shard that a text such as 2/3 names."""
        found = re.fullmatch(r"(\d{1,6})/(\d{1,6})", text, re.ASCII)
        if found and 1 <= int(found[1]) <= int(found[2]):
            return cls(int(found[1]), int(found[2]))
        raise OptionError(
            f"--shard {text} is not understood; give k/n with k from 1 to n, as in 2/3: the second of three"
        )

    def __str__(self) -> str:
        """Return it as it is typed."""
        return f"{self.number}/{self.count}"

    def part(self, items: Sequence[Any]) -> Sequence[Any]:
        """Return those of the items that are its own."""
        return items[self.number - 1 :: self.count]

    def require_alone(self, **others: bool) -> None:
        """Raise OptionError where an option is given that makes no sense with a shard.

        Parameters
        ----------
        **others : bool
            Whether each of them is given, by name.
        """
        for name, given in others.items():
            if given:
                raise OptionError(f"--shard {self} with --{name.replace('_', '-')}: {REFUSED[name]}")


REFUSED = {
    "resume": "a shard goes on by itself with what it finds, and --resume without --shard gathers what all "
    "shards found; give one of them",
    "force": "it would remove what other shards have done; remove the folder, or give another one with --out",
    "json": "a shard has no results to print; --resume, which gathers those of all shards, prints them",
    "keep": "the run that gathers all shards decides what is kept; give it there",
    "sweep": "a shard is a part of one run; give each value a folder and shards of its own",
    "executor": "a shard runs in processes of its machine, see --workers; leave out one of them",
    "until_error": "its pilot would be run by every shard; give the number of --replicas instead",
}


@dataclass(frozen=True)
class SharedShelf(Shelf):
    """A shelf on which several processes work.

    Attributes
    ----------
    shard : Shard
        Which part this one does.
    presence : Path
        The file that says where it runs.
    """

    shard: Shard = Shard(1, 1)
    presence: Path = Path()

    def has(self, number: int) -> bool:
        """Return whether there is a result of an item, without a look at it."""
        return self._path("done", number).exists()

    def claim(self, number: int) -> bool:
        """Return whether this shard is to run an item now: neither finished nor run by another process."""
        path = self.folder / f"claim-{number:04d}"
        if self.result(number) is not None:
            return False
        owner = _owner(path)
        if owner not in (None, self.presence.name):
            holder = Presence.of(self.folder / owner) if NAMED.fullmatch(owner) else None
            if holder is not None and holder.goes_on(self.presence):
                return False
        with not_written(), (placing if owner is None else replacing)(path) as temporary:
            temporary.write_text(self.presence.name, encoding="utf-8")
        return self._holds(number) and self.result(number) is None

    def store(self, number: int, result: Any) -> None:
        """Save the result of an item; the first one stays."""
        if self._holds(number) and self.result(number) is None:
            super().store(number, result)

    def save(self, number: int, state: Any) -> None:
        """Save the state of a running item, unless another process has taken it over."""
        if self._holds(number):
            super().save(number, state)

    def _holds(self, number: int) -> bool:
        return _owner(self.folder / f"claim-{number:04d}") == self.presence.name


def _owner(path: Path) -> str | None:
    """Return what a claim says, None where there is none."""
    try:
        return path.read_text(encoding="utf-8")
    except OSError:
        return None
    except ValueError:  # damaged
        return ""


@dataclass(frozen=True)
class _Claimed:
    """A task for items with their numbers on a shelf: what nobody else does is done, and stays there."""

    task: Callable[[Any], Any]
    shelf: SharedShelf

    def __call__(self, numbered: tuple[int, Any]) -> None:
        number, item = numbered
        if self.shelf.claim(number):
            perform(self.task, item, self.shelf, number)


def run_part(
    task: Callable[[Any], Any],
    items: Sequence[tuple[int, Any]],
    shelf: SharedShelf,
    screen: Screen,
    **how: Any,
) -> None:
    """Run a shard's part of the items, leave what it finds on the shelf, and say what was done.

    Parameters
    ----------
    task : callable
        As for `run_replicas`.
    items : sequence of (int, item)
        All that there are, each with its number on the shelf.
    shelf : SharedShelf
        Where the results stay.
    screen : Screen
        Where it is told.
    **how
        More for `run_replicas`.
    """
    part = shelf.shard.part(items)
    with screen.progress("runs of this shard", len(part)) as advance:
        run_replicas(_Claimed(task, shelf), part, done=advance, note=screen.note, **how)
    there = {number for number, _ in items if shelf.has(number)}
    finished = sum(number in there for number, _ in part)
    if not part:
        told = "has nothing to run"
    elif finished == len(part):
        told = f"has finished its {finished} run{'s' * (finished > 1)}"
    else:
        told = f"has finished {finished} of its {len(part)} runs, and another process runs the rest"
    screen.say(
        f"shard {shelf.shard} {told}; {len(there)} of the study's {len(items)} are in {shelf.folder.parent}"
    )
    screen.say(
        f"when all shards have ended, the same command with --resume in place of --shard {shelf.shard} runs "
        "what is missing and writes the results"
    )
