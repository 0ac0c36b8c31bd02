"""`hyrecro up`, `teleop`, `demo`, `simulate`, `router`, `doctor`: start the pipeline or a part, or look at it."""

from __future__ import annotations

import contextlib
import sys
import time
from pathlib import Path
from typing import Annotated

import typer

from cli.options import DEFAULT_CONFIG, ConfigOption, JsonOption, Part, SetOption, resolved, service_arguments

_REJOIN_PERIOD_S = 2.0

EndpointOption = Annotated[str | None, typer.Option(help="Where to listen; default bus.endpoint.")]

PartOption = Annotated[
    Part | None, typer.Option(help="Of two hosts: base is recorder, evaluator and page, robot the rest.")
]

PeersOption = Annotated[
    list[str] | None,
    typer.Option("--connect", metavar="ENDPOINT", help="Another host's router, also if it runs later."),
]


def register(app: typer.Typer) -> None:
    """Adds the commands to the top of the command tree."""
    for command in (up, teleop, demo, simulate, router, doctor):
        app.command()(command)


def up(
    has_page: Annotated[bool, typer.Option("--teleop", help="With the page in a browser.")] = False,
    is_joining: Annotated[bool, typer.Option("--join", help="Another robot, on the router that runs.")] = False,
    part: PartOption = None,
    config: ConfigOption = DEFAULT_CONFIG,
    set_: SetOption = None,
) -> None:
    """Starts router, simulation, sensors, mapper, evaluator, recorder, and keeps them running; Ctrl-C stops all."""
    from cli.pipeline import Pipeline
    from shared.runtime.logs import configure_logs
    from shared.runtime.run_folder import run_folder, run_name
    from shared.runtime.snapshots import state_folder
    from shared.runtime.stop_signal import StopSignal

    set_ = [*(set_ or []), *(["teleop.enabled=true"] if has_page else [])]
    settings = resolved(config, set_)
    name = run_name(settings.recorder, settings.bus.namespace)
    stop = StopSignal()
    configure_logs(verbosity=-1)
    with contextlib.ExitStack() as stack:
        state = stack.enter_context(state_folder(settings.state_directory))
        arguments = service_arguments(config, [*set_, f"recorder.run={name}", f"state_directory={state}"])
        pipeline = stack.enter_context(Pipeline(settings, arguments, is_joining=is_joining, part=part))
        pipeline.start(stop.is_set)
        folder = run_folder(settings.recorder, name)
        if not stop.is_set():
            page = f", page at {settings.teleop.url}" if settings.teleop.enabled and part != "robot" else ""
            recording = f", recording {folder}/run.mcap" if part != "robot" else ""
            robot = f"{settings.bus.namespace} " if settings.bus.namespace else ""
            print(f"{robot}up at {settings.bus.endpoint}{recording}{page}; Ctrl-C stops", file=sys.stderr)
        while not stop.is_set():
            pipeline.check()
            time.sleep(0.1)
    raise typer.Exit(pipeline.exit_code or stop.exit_code())


def teleop(config: ConfigOption = DEFAULT_CONFIG, set_: SetOption = None) -> None:
    """Drives the running robot from a page in a browser; Ctrl-C ends the page, and halts what it has set off."""
    from argparse import Namespace

    from services.teleop.node import build_node
    from shared.runtime.config import Config
    from shared.runtime.node import Context, Node
    from shared.runtime.runner import run_service

    def build(settings: Config, context: Context) -> Node:
        node = build_node(service_arguments(config, set_ or []), settings, context)
        print(f"page at {settings.teleop.url}; Ctrl-C ends it", file=sys.stderr)
        return node

    run_service("teleop", build, Namespace(config=config, set=set_ or [], verbosity=-1, log_json=False))


def demo(config: ConfigOption = DEFAULT_CONFIG, set_: SetOption = None, is_json: JsonOption = False) -> None:
    """Climbs, senses, maps and records once; then scores the map against the truth and says how to look at it."""
    from cli.demo import run_demo

    raise typer.Exit(run_demo(config, set_ or [], is_json=is_json))


def simulate(
    trajectory: Annotated[Path, typer.Argument(metavar="TRAJECTORY.csv")],
    out: Annotated[Path, typer.Option(help="An empty or new folder.")],
    scans: Annotated[int | None, typer.Option(min=1, help="Evenly over the climb; default: the LiDAR's rate.")] = None,
    seed: Annotated[int | None, typer.Option(min=0, help="Of all random numbers; default from the settings.")] = None,
    config: ConfigOption = DEFAULT_CONFIG,
    set_: SetOption = None,
) -> None:
    """Climbs and scans without any bus: data0.pcd ..., labels, truth.tum, joints.csv; the same seed, the same bytes."""
    from cli.playback import progress_bar
    from cli.simulate import simulate as run

    overrides = [*(set_ or []), f"player.trajectory={trajectory.resolve()}"]
    overrides += [f"seed={seed}"] if seed is not None else []
    with progress_bar() as progress:
        num_scans = run(resolved(config, overrides), out, scans, progress)
    typer.echo(f"{num_scans} scans in {out}")


def router(
    endpoint: EndpointOption = None,
    peers: PeersOption = None,
    config: ConfigOption = DEFAULT_CONFIG,
    set_: SetOption = None,
) -> None:
    """Runs a Zenoh router, on loopback unless told otherwise."""
    from shared.messaging.router import open_router
    from shared.runtime.notify import Pulse
    from shared.runtime.stop_signal import StopSignal

    bus = resolved(config, set_).bus
    endpoint = endpoint or bus.endpoint
    stop, pulse = StopSignal(), Pulse.from_environment()
    with open_router(endpoint, credentials=bus.credentials, peers=peers or []) as opened:
        joined = f", joins {', '.join(peers)}" if peers else ""
        print(f"router listens at {endpoint}{joined}", file=sys.stderr)
        pulse.ready()
        looked_s = time.monotonic()
        while not stop.is_set():
            pulse.beat()
            if peers and time.monotonic() - looked_s > _REJOIN_PERIOD_S:
                if opened.rejoin():
                    print(f"router at {endpoint} heard nothing over its links: opened anew", file=sys.stderr)
                looked_s = time.monotonic()
            time.sleep(0.1)
        pulse.stopping()
    raise typer.Exit(stop.exit_code())


def doctor(
    alive: Annotated[str | None, typer.Option(help="Only check that this service is alive.")] = None,
    config: ConfigOption = DEFAULT_CONFIG,
    set_: SetOption = None,
    is_json: JsonOption = False,
) -> None:
    """Checks this machine and the configuration; exit code 1 if something that is needed is missing."""
    from cli.doctor import run_doctor

    raise typer.Exit(run_doctor(config, set_ or [], alive=alive, is_json=is_json))
