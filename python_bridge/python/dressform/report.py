"""What a person sees: progress on a terminal, and tables. Everything but results goes to stderr."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import TracebackType
from typing import Any

from rich import progress as bars
from rich.console import Console
from rich.table import Table

from .result import GarmentReport, Result

#: The stages in their order, as progress and ``seconds`` name them.
STAGES = ("read", "transfer", "pattern", "drape", "rig", "certify", "write")


class Progress:
    """A bar for the stage that runs; silent where stderr is no terminal."""

    def __init__(self, *, quiet: bool = False) -> None:
        console = Console(stderr=True)
        self._bars = bars.Progress(
            bars.TextColumn("{task.description:>9}"),
            bars.BarColumn(),
            bars.TaskProgressColumn(),
            bars.TimeElapsedColumn(),
            console=console,
            disable=quiet or not console.is_terminal,
            transient=True,
        )
        self._task: bars.TaskID | None = None
        self._stage = ""

    def __enter__(self) -> Progress:
        self._bars.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._bars.stop()

    def __call__(self, stage: str, fraction: float) -> None:
        if stage != self._stage or self._task is None:
            self._stage, self._task = stage, self._bars.add_task(stage, total=1.0)
        self._bars.update(self._task, completed=fraction)


def show_result(result: Result) -> None:
    """A summary of a fit."""
    console = Console(highlight=False)
    table = Table(box=None, pad_edge=False, header_style="bold")
    table.add_column("garment")
    for name in (
        "layer",
        "gap p99",
        "seam mismatch",
        "inside body",
        "crossings",
        "strain change p99",
        "rest",
    ):
        table.add_column(name, justify="right")
    for garment in result.garments:
        table.add_row(*_row(garment))
    console.print(table)
    _show_ease(console, result)
    times = "  ".join(f"{s} {result.seconds[s]:.1f}" for s in STAGES if s in result.seconds)
    console.print(f"seconds: {times}  total {result.seconds['total']:.1f}", style="dim")
    console.print(f"ran on {result.device.name} ({result.device.kind})", style="dim")
    for note in result.notes:
        console.print(f"note: {note}", style="dim", markup=False)
    for broken in result.broken:
        console.print("[yellow]threshold broken:[/yellow]", end=" ")
        console.print(broken, markup=False)
    verdict = "[green]passed[/green]" if result.passed else "[yellow]not passed[/yellow]"
    console.print(f"{verdict}, written to", end=" ")
    console.print(result.output, markup=False, soft_wrap=True)


def _row(garment: GarmentReport) -> list[str]:
    sure = garment.certificate
    crossings = (sure.body_intersections, sure.layer_intersections, sure.self_intersections)
    return [
        garment.name,
        str(garment.layer),
        f"{1e3 * garment.transfer.gap_p99_m:.2f} mm",
        f"{100 * garment.pattern.seam_mismatch_max:.2f} %",
        f"{1e3 * sure.body_penetration_max_m:.2f} mm",
        "{} body, {} layers, {} self".format(*crossings),
        f"{100 * sure.strain_change_p99:.1f} %",
        "yes" if garment.drape.at_rest else f"no ({garment.drape.residual:.2g})",
    ]


def show_simulation(found: Mapping[str, Any]) -> None:
    """A summary of a simulation."""
    console = Console(highlight=False, soft_wrap=True)
    table = Table(box=None, pad_edge=False, header_style="bold")
    for name in ("garment", "frames", "steps", "not converged", "blocked", "frames with crossings"):
        table.add_column(name, justify="left" if name == "garment" else "right")
    for garment in found["garments"]:
        drape = garment["drape"]
        keys = ("frames", "steps", "unconverged_steps", "blocked_steps")
        table.add_row(garment["path"], *(str(drape[k]) for k in keys), str(garment["crossed_frames"]))
    console.print(table)
    for note in found["notes"]:
        console.print(f"note: {note}", style="dim", markup=False)
    console.print(f"written to {found['output']}", markup=False)


def _show_ease(console: Console, result: Result) -> None:
    """Girths of garments and bodies, where there are any."""
    table = Table(box=None, pad_edge=False, header_style="bold")
    for name in ("ease [cm]", "girth"):
        table.add_column(name)
    for name in ("source", "target", "target body", "held"):
        table.add_column(name, justify="right")
    for garment in result.garments:
        for entry in garment.ease.girths:
            words = " ".join(filter(None, [entry.side, entry.girth.replace("_", " ")]))
            table.add_row(
                garment.name,
                words + (" (open)" if entry.open else ""),
                f"{100 * entry.source.ease_m:+.1f}",
                f"{100 * entry.target.ease_m:+.1f}",
                f"{100 * entry.target.body_m:.1f}",
                "" if entry.held_m is None else f"{100 * entry.held_m:+.1f}",
            )
    if table.row_count:
        console.print(table)


def show_check(found: Mapping[str, Any]) -> None:
    """What a stage holds."""
    console = Console(highlight=False, soft_wrap=True)
    unit = found["meters_per_unit"]
    console.print(
        f"{found['file']}" + (f" ({found['up_axis']} up, {unit:g} m per unit)" if unit else ""), markup=False
    )
    for kind in ("bodies", "skeletons", "garments"):
        for entry in found[kind]:
            console.print(f"  {kind[:-1] if kind != 'bodies' else 'body'} {_entry(entry)}", markup=False)
            for panel in (entry.get("proxy") or {}).get("left_out", []):
                console.print(f"    not simulated: panel {panel['panel']}, {panel['why']}", markup=False)
    for problem in found["problems"]:
        color = "red" if problem["severity"] == "error" else "yellow"
        console.print(f"[{color}]{problem['severity']}:[/{color}]", end=" ")
        console.print(_problem(problem), markup=False)
    if found["ok"]:
        console.print("[green]good[/green]")


def _entry(entry: Mapping[str, Any]) -> str:
    words = [str(entry.get("path", ""))]
    for key, value in entry.items():
        if key in ("path", "name"):
            continue
        if isinstance(value, Sequence) and not isinstance(value, str):
            words.append(f"{len(value)} {key}")
        elif isinstance(value, str | int | float) and not isinstance(value, bool):
            words.append(f"{key} {value}")
    return ", ".join(words)


def _problem(problem: Mapping[str, Any]) -> str:
    from .errors import where

    spot = where(problem["file"], problem["prim"], problem["attribute"], problem["element"])
    return f"{spot}: {problem['message']}"


def show_devices(found: Sequence[Mapping[str, Any]]) -> None:
    """The devices, one a line."""
    console = Console(highlight=False, soft_wrap=True)
    for device in found:
        words = [f"{device['kind']:<10}", str(device["name"])]
        if device.get("driver"):
            words.append(f"({device['driver']})")
        if device.get("reason"):
            words.append(f"- not usable: {device['reason']}")
        console.print(" ".join(words), markup=False)
