"""The moving gas in a browser: every collision, exactly, forwards and backwards.

Files in reading order: `replay` (the start and the events, as a page), `viewer.mjs` (the page's program),
`command` (`hardspheres view`).
"""

from studies.viewer.replay import Replay, view

__all__ = ["Replay", "view"]
