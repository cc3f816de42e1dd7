"""Studies and the command line: scene, run, analysis, report."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from studies.viewer import Replay, view

__all__ = ["Replay", "view"]


def __getattr__(name: str) -> Any:  # importing this package stays cheap
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from studies.viewer import replay

    return getattr(replay, name)
