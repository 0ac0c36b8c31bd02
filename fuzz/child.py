"""One campaign over one target: `python -m fuzz.child TARGET CORPUS [libFuzzer's options]`, until libFuzzer ends it."""

from __future__ import annotations

import sys
import warnings
from pathlib import Path

import atheris

with atheris.instrument_imports(
    include=[
        "cli.sweep_spec",
        "mcap",
        "ruamel",
        "services.player",
        "services.recorder",
        "services.sensors.lidar.beam_files",
        "services.sensors.sources",
        "services.teleop.postures",
        "shared",
        "trimesh.exchange",
    ]
):
    from fuzz.targets import TARGETS


def main() -> None:
    """Writes the target's examples into the corpus and lets libFuzzer go on from there."""
    name, corpus, *options = sys.argv[1:]
    target = TARGETS[name]
    for number, example in enumerate(target.examples()):
        (Path(corpus) / f"example_{number}").write_bytes(example)
    warnings.simplefilter("error")
    atheris.Setup(
        [sys.argv[0], corpus, f"-max_len={target.max_bytes}", *options], lambda data: target.run(data) and None
    )
    atheris.Fuzz()


if __name__ == "__main__":
    main()
