"""Draw the two searches of the engine, `lists.png` and `windows.png`: true geometry of a few discs.

Run it from the project's folder.
"""

import itertools
import math
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib import patches, pyplot

from analysis.estimator import PALETTE
from hardspheres import contact_time

matplotlib.use("Agg")
DARK, BLUE, RED, GREY = "#1d2733", PALETTE[0], PALETTE[1], "#9aa7b5"
STYLE = {"font.size": 10, "axes.titlesize": 10.5, "legend.fontsize": 9, "legend.frameon": False}
HERE = Path(__file__).parent


def discs(rng, n, box, least):
    """Place n centres at random, none two nearer than `least`."""
    centres = []
    while len(centres) < n:
        x = rng.uniform(0, box)
        if all(np.hypot(*(x - y)) > least for y in centres):
            centres.append(x)
    return np.array(centres)


def meeting(r, v, contact):
    """Time of contact of two with separation r and relative velocity v; infinity where they miss."""
    b, c, vv = r @ v, r @ r - contact**2, v @ v
    return contact_time(b, c, math.sqrt(max(0.0, b * b - vv * c)))


def axes_of(ax, box, edges):
    """Show the box with its cells."""
    ax.set(xlim=(0, box[0]), ylim=(0, box[1]), aspect="equal", xticks=[], yticks=[])
    for axis, edge in zip("xy", edges, strict=True):
        for at in np.arange(0, box["xy".index(axis)] + 1e-9, edge):
            (ax.axvline if axis == "x" else ax.axhline)(at, color="0.88", lw=0.8, zorder=0)
    for spine in ax.spines.values():
        spine.set(visible=False)


def key(ax, handles):
    """Put the legend below."""
    ax.legend(handles=handles, loc="upper center", bbox_to_anchor=(0.5, -0.02), ncols=2)


def disc(x, radius, **look):
    """Return a circle."""
    return patches.Circle(x, radius, **look)


def line(**look):
    """Return an entry of a legend."""
    return matplotlib.lines.Line2D([], [], **look)


def swatch(**look):
    """Return an entry of a legend."""
    return patches.Patch(**look)


def buckets(ax, events, width, count, words):
    """Draw times of events, sorted into buckets: below the row of buckets, the heap of the current one."""
    for k in range(count):
        ax.add_patch(patches.Rectangle((k, 0), 1, 1, fc="#fdf3dc" if k == 0 else "white", ec="0.6"))
    stacked = {}
    for time, text, colour in sorted(events):
        k = int(time / width)
        if k >= count:
            continue
        level = stacked[k] = stacked.get(k, 0) + 1
        ax.text(k + 0.5, 1 - 0.17 * level, text, ha="center", va="center", fontsize=8, color=colour)
    ax.annotate("", (count, -0.12), (0, -0.12), arrowprops={"arrowstyle": "->", "color": "0.4"})
    ax.text(count / 2, -0.22, "time", ha="center", va="top", color="0.4")
    ax.set(xlim=(-0.1, count + 0.1), ylim=(-0.75, 1.1))
    ax.text(0, -0.42, words, ha="left", va="top", fontsize=9)
    ax.axis("off")


def lists():
    """Neighbour lists: the cutoff and the displacement threshold round a particle's reference position."""
    rng = np.random.default_rng(4)
    box, radius, shell = np.array([9.6, 9.6]), 0.5, 0.42
    cutoff = 2 * radius + 2 * shell
    n, edge = 46, 9.6 / 5  # cells at least as wide as the cutoff
    assert edge >= cutoff
    x, v = discs(rng, n, box, 1.06), rng.normal(size=(n, 2))
    ahead = np.clip(0.3 * v, -0.5 * shell, 0.5 * shell)  # some way ahead, within the threshold
    reference = x + ahead
    i = int(np.argmin(np.hypot(*(x - box / 2).T)))
    apart = np.hypot(*(reference - reference[i]).T)
    listed = [j for j in range(n) if j != i and apart[j] <= cutoff]
    times = {j: meeting(x[i] - x[j], v[i] - v[j], 2 * radius) for j in listed}
    first = min(times, key=times.get)
    figure, (ax, right) = pyplot.subplots(
        1, 2, figsize=(9.2, 5.4), width_ratios=(1, 1.05), layout="constrained"
    )
    axes_of(ax, box, (edge, edge))
    cell = (reference[i] // edge) * edge
    ax.add_patch(patches.Rectangle(cell - edge, 3 * edge, 3 * edge, fc="#fdf3dc", ec="none", zorder=-1))
    for j in range(n):
        colour = BLUE if j == i else ("#bcd7ea" if j in listed else "#eceff2")
        ax.add_patch(disc(x[j], radius, fc=colour, ec="0.5", lw=0.6))
        ax.plot(*reference[j], "+", color="0.35", ms=4)
        ax.text(*(x[j] - 0.2 * np.sign(ahead[j])), j, fontsize=6, color="0.35", ha="center", va="center")
    for j in (i, *listed):
        ax.annotate("", x[j] + 0.45 * v[j], x[j], arrowprops={"arrowstyle": "->", "color": DARK, "lw": 1})
    ax.add_patch(disc(reference[i], shell, fc="none", ec=RED, lw=1.6))
    ax.add_patch(disc(reference[i], cutoff, fc="none", ec=RED, lw=1.6, ls="--"))
    t = times[first]
    for j in (i, first):
        ax.add_patch(disc(x[j] + t * v[j], radius, fc="none", ec=DARK, lw=1.2, ls=":", zorder=5))
    key(
        ax,
        [
            line(marker="o", ls="", color=BLUE, label="the particle"),
            line(marker="o", ls="", color="#bcd7ea", mec="0.5", label="on its neighbour list"),
            line(color=RED, label="displacement threshold"),
            line(color=RED, ls="--", label="cutoff: contact + two thresholds"),
            line(marker="+", ls="", color="0.35", label="reference positions"),
            swatch(fc="#fdf3dc", label="the 9 cells searched"),
            line(color=DARK, ls=":", label="earliest predicted contact"),
        ],
    )
    events = []
    for k in range(n):
        step = v[k]
        off = x[k] - reference[k]
        a, b, c = step @ step, off @ step, off @ off - shell**2
        leave = (-b + math.sqrt(b * b - a * c)) / a  # the displacement threshold
        near = np.hypot(*(reference - reference[k]).T)
        found = [(leave, f"{k}: list")]
        for j in range(n):
            if j != k and near[j] <= cutoff:
                found.append((meeting(x[k] - x[j], v[k] - v[j], 2 * radius), f"{k}, {j}"))
        events.append(min(found))
    shown = sorted(events)[:26]
    seen, once = set(), []
    for time, text in shown:
        pair = tuple(sorted(text.split(", ")))
        if pair not in seen:
            seen.add(pair)
            once.append((time, text, RED if "list" in text else DARK))
    width = (once[-1][0] + 1e-9) / 6
    words = (
        "Each particle has one next event in the calendar: a contact\n"
        "(i, j) or the crossing of its displacement threshold (i: list),\n"
        "after which it gets a new list. The first bucket is the current\n"
        "one; its events are in a heap."
    )
    buckets(right, once, width, 6, words)
    right.set_title("Calendar", loc="left")
    ax.set_title("Dense gas: neighbour lists", loc="left")
    figure.savefig(HERE / "lists.png", dpi=90)


def windows():
    """Windows: the trajectory segments of a short time, their boxes, and the contacts among them."""
    rng = np.random.default_rng(SEED)
    box, radius, length = np.array([18.0, 14.4]), 0.5, 1.0
    n, edge = 28, 3.6
    x = discs(rng, n, box - 3, 1.2) + 1.5
    v = rng.normal(size=(n, 2)) * 0.9
    stretch = 0.5 * (edge - 2 * radius)  # half-length of a segment along an axis, at most
    assert np.all(np.abs(v) * length / 2 <= stretch), "one piece each"
    low, high = np.minimum(x, x + v * length) - radius, np.maximum(x, x + v * length) + radius
    pairs, contacts = [], []
    for a, b in itertools.combinations(range(n), 2):
        if np.all(low[a] <= high[b]) and np.all(low[b] <= high[a]):
            pairs.append((a, b))
            t = meeting(x[a] - x[b], v[a] - v[b], 2 * radius)
            if t < length:
                contacts.append((t, a, b))
    near = {j for pair in pairs for j in pair}
    hits = {j for _, a, b in contacts for j in (a, b)}
    figure, (ax, right) = pyplot.subplots(
        1, 2, figsize=(9.2, 4.6), width_ratios=(1.45, 1), layout="constrained"
    )
    axes_of(ax, box, (edge, edge))
    for j in range(n):
        colour = RED if j in hits else (BLUE if j in near else GREY)
        ax.add_patch(patches.Rectangle(low[j], *(high[j] - low[j]), fc=colour, alpha=0.13, ec="none"))
        ax.add_patch(patches.Rectangle(low[j], *(high[j] - low[j]), fc="none", ec=colour, lw=0.9))
        ax.add_patch(disc(x[j], radius, fc="#eceff2", ec="0.5", lw=0.6))
        ax.annotate("", x[j] + v[j] * length, x[j], arrowprops={"arrowstyle": "->", "color": DARK, "lw": 1.1})
        ax.plot(*(x[j] + 0.5 * length * v[j]), ".", color=DARK, ms=4)
        if j in hits:
            ax.text(low[j, 0], high[j, 1], j, fontsize=8, color=RED, ha="right", va="bottom")
    for t, a, b in contacts:
        for j in (a, b):
            ax.add_patch(disc(x[j] + t * v[j], radius, fc="none", ec=DARK, lw=1.2, ls=":"))
    key(
        ax,
        [
            line(marker=r"$\rightarrow$", ms=10, ls="", color=DARK, label="segment of a trajectory"),
            line(marker=".", ls="", color=DARK, label="its middle, which decides its cell"),
            swatch(fc="#edf0f3", ec=GREY, label="box that overlaps no other"),
            swatch(fc="#dceaf4", ec=BLUE, label="overlaps one, but no contact"),
            swatch(fc="#f8e4e4", ec=RED, label="contact within the window"),
            line(color=DARK, ls=":", label="positions at contact"),
        ],
    )
    events = [(t, f"{a}, {b}", RED) for t, a, b in contacts]
    words = (
        f"{n * (n - 1) // 2} pairs, {len(pairs)} with overlapping boxes,\n"
        f"{len(contacts)} contacts. Both partners of a contact\n"
        "get new segments, which are compared\nwith those around them."
    )
    buckets(right, events, length / 4, 4, words)
    right.set_title("Contacts of this window", loc="left")
    ax.set_title("Dilute gas: a window of time", loc="left")
    figure.savefig(HERE / "windows.png", dpi=90)


SEED = 49  # four contacts within the window
if __name__ == "__main__":
    with matplotlib.rc_context(STYLE):
        lists()
        windows()
