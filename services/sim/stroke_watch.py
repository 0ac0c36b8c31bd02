"""Joint commands may ask for more than the pistons' strokes: nobody is stopped, but it is said, once each time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shared.robot.actuators import ActuatorGeometry, actuator_refusals


class StrokeWatch:
    """Notices when pistons leave their strokes: the prototype could not follow there."""

    def __init__(self, geometry: ActuatorGeometry) -> None:
        self._geometry = geometry
        self._is_beyond = False

    def look(self, values: NDArray[np.float64]) -> list[str]:
        """A text if some actuators of (10,) are beyond their strokes and none was when looked at last."""
        reasons = actuator_refusals(values, self._geometry)
        was_beyond, self._is_beyond = self._is_beyond, bool(reasons)
        if was_beyond or not reasons:
            return []
        return [f"the joints ask for more than the pistons' strokes: {'; '.join(reasons)}"]
