"""The backends by name."""

from __future__ import annotations

from services.sensors.rays.interface import RayBackend


def make_backend(name: str) -> RayBackend:
    """`scan_conversion` or `embree`; each brings its own heavy imports."""
    if name == "embree":
        from services.sensors.rays.embree import EmbreeBackend

        return EmbreeBackend()
    from services.sensors.rays.scan_conversion import ScanConversionBackend

    return ScanConversionBackend()
