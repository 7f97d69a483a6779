"""State of a commissioning: what its stages found, kept so that it can be gone on with."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from flexarm_core.errors import FlexarmError
from flexarm_core.outputs import MARK_KEY

if TYPE_CHECKING:
    from pathlib import Path

STATE_FILE = "commission.json"


class StateError(FlexarmError):
    """State of another commissioning in the folder."""


@dataclass
class State:
    """Findings of the stages so far, in a file that is replaced as a whole.

    Attributes
    ----------
    folder : Path
        Folder of the commissioning.
    settings : dict
        What the stages rest on: the description's text and the goal.
    found : dict
        Findings by stage.
    """

    folder: Path
    settings: dict[str, Any]
    found: dict[str, Any] = field(default_factory=dict)

    @classmethod
    def of(cls, folder: Path, settings: dict[str, Any]) -> State:
        """Return the state in a folder, or a new one.

        Raises
        ------
        StateError
            When the folder has that of another arm or goal.
        """
        file = folder / STATE_FILE
        if not file.exists():
            return cls(folder, settings)
        try:
            known = json.loads(file.read_text("utf-8"))
            before, found = known["settings"], known["found"]
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise StateError(f"{file}: cannot be read: choose another --out, or remove it") from (
                error
            )
        changed = [name for name, value in settings.items() if before.get(name) != value]
        if changed:
            raise StateError(
                f"{file}: began with another {' and '.join(changed)}: choose another --out, or "
                f"remove {folder}"
            )
        return cls(folder, settings, found)

    def note(self, stage: str, finding: Any) -> None:  # noqa: ANN401 - JSON
        """Keep what a stage found."""
        self.found[stage] = finding
        draft = self.folder / f".{STATE_FILE}"
        content = {**MARK_KEY, "settings": self.settings, "found": self.found}
        draft.write_text(json.dumps(content, indent=1) + "\n", "utf-8")
        draft.replace(self.folder / STATE_FILE)
