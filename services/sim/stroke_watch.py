"""Joint commands may ask for more than the pistons' strokes: nobody is stopped, but it is said, once each time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shared.robot.actuators import ActuatorGeometry, actuator_refusals


class StrokeWatch:
    """Remembers which actuators are beyond their strokes: the prototype could not follow there."""

    def __init__(self, geometry: ActuatorGeometry) -> None:
        self._geometry = geometry
        self._known: set[str] = set()

    def look(self, values: NDArray[np.float64]) -> list[str]:
        """A text for each actuator of (10,) that was not beyond its stroke when looked at last."""
        reasons = {
            text.split(" ")[0]: f"beyond its stroke: {text}" for text in actuator_refusals(values, self._geometry)
        }
        news = [text for name, text in reasons.items() if name not in self._known]
        self._known = set(reasons)
        return news
