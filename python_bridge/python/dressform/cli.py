"""The command line. Exit codes:

0 done, and within every threshold (``check``: no problem found); 1 done and written, but a threshold
of the certificate is broken; 2 usage; 3 bad input; 4 device; 5 a bug of dressform's own;
130 interrupted.
"""

from __future__ import annotations

import json
import os
import sys
import traceback
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from . import report
from .errors import DressformError

BROKEN, INTERNAL, INTERRUPTED = 1, 5, 130
#: Set to print the whole traceback of an error.
TRACEBACK_VARIABLE = "DRESSFORM_TRACEBACK"

app = typer.Typer(
    name="dressform",
    help="Fits outfits to characters: transfer, pattern refit, drape, rig, as USD layers.",
    epilog="Exit codes: 0 done, 1 a threshold is broken, 2 usage, 3 bad input, 4 device, 5 a bug.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

Device = Annotated[str, typer.Option(help="auto, cpu, gpu, or a part of an adapter's name.")]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else.")]


def main() -> None:
    """Runs the command line; ends the process with its exit code."""
    sys.exit(run())


def run(arguments: list[str] | None = None) -> int:
    """Runs one command and returns its exit code."""
    try:
        app(arguments)
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else INTERNAL
    except KeyboardInterrupt:
        return INTERRUPTED
    except DressformError as error:
        _say(error, str(error))
        return error.exit_code
    except Exception as error:  # whatever was not foreseen is a bug, and never a traceback alone
        _say(error, f"internal fault: {type(error).__name__}: {error}")
        return INTERNAL
    return 0


def _say(error: BaseException, message: str) -> None:
    console = Console(stderr=True, highlight=False, soft_wrap=True)
    console.print("[red]error:[/red]", end=" ")
    console.print(message, markup=False)
    if os.environ.get(TRACEBACK_VARIABLE):
        traceback.print_exception(error, file=sys.stderr)
    elif getattr(error, "exit_code", INTERNAL) == INTERNAL:
        console.print(f"Set {TRACEBACK_VARIABLE}=1 to see where.", style="dim")


def _print_json(value: Any) -> None:
    sys.stdout.write((value if isinstance(value, str) else json.dumps(value, allow_nan=False)) + "\n")


@app.command()
def fit(
    outfit: Annotated[str, typer.Argument(help="Stage with one or more garments.")],
    character: Annotated[str, typer.Argument(help="Stage with a body mesh and a skeleton.")],
    out: Annotated[str, typer.Option("-o", "--out", help="Root layer to write (.usda or .usdc).")],
    settings: Annotated[str | None, typer.Option(help="Settings, a TOML file.")] = None,
    device: Device = "auto",
    as_json: Json = False,
    no_clobber: Annotated[bool, typer.Option("--no-clobber", help="Refuse to replace OUT.")] = False,
    cache: Annotated[
        str | None,
        typer.Option(metavar="DIR", envvar="DRESSFORM_CACHE", help="Keep the flows between bodies here."),
    ] = None,
) -> None:
    """Fit an outfit to a character and write the dressed character."""
    from . import fitting
    from .settings import Settings, load

    chosen = Settings() if settings is None else load(settings)
    with report.Progress(quiet=as_json) as progress:
        result = fitting.fit(
            outfit,
            character,
            out,
            settings=chosen,
            device=device,
            clobber=not no_clobber,
            progress=progress,
            cache=cache,
        )
    if as_json:
        _print_json(result.to_json())
    else:
        report.show_result(result)
    if not result.passed:
        raise typer.Exit(BROKEN)


@app.command()
def simulate(
    dressed: Annotated[str, typer.Argument(metavar="DRESSED", help="What fit wrote, animated.")],
    out: Annotated[str, typer.Option("-o", "--out", help="Layer to write over it (.usda or .usdc).")],
    start: Annotated[float | None, typer.Option(help="First time code; the animation's by default.")] = None,
    end: Annotated[float | None, typer.Option(help="Last time code.")] = None,
    lead_in: Annotated[int, typer.Option(min=1, help="Frames from the bind pose to the first.")] = 24,
    settings: Annotated[str | None, typer.Option(help="Settings, a TOML file.")] = None,
    device: Device = "auto",
    as_json: Json = False,
    no_clobber: Annotated[bool, typer.Option("--no-clobber", help="Refuse to replace OUT.")] = False,
) -> None:
    """Simulate the garments of a dressed, animated character; write their points over time."""
    from .settings import Settings, load
    from .simulating import simulate as run_simulation

    with report.Progress(quiet=as_json) as progress:
        found = run_simulation(
            dressed,
            out,
            start=start,
            end=end,
            lead_in=lead_in,
            settings=Settings() if settings is None else load(settings),
            device=device,
            clobber=not no_clobber,
            progress=progress,
        )
    if as_json:
        _print_json(found)
    else:
        report.show_simulation(found)


@app.command()
def check(
    stage: Annotated[str, typer.Argument(help="Outfit, character, or both.")],
    settings: Annotated[str | None, typer.Option(help="Settings, a TOML file.")] = None,
    as_json: Json = False,
) -> None:
    """Read and validate a stage, and say what it holds and what is wrong with it."""
    from .check import check as check_stage
    from .settings import load

    found = check_stage(stage, settings=None if settings is None else load(settings))
    if as_json:
        _print_json(found)
    else:
        report.show_check(found)
    if not found["ok"]:
        raise typer.Exit(3)


@app.command()
def devices(as_json: Json = False) -> None:
    """List what --device can name."""
    from . import _native

    found = _native.devices()
    if as_json:
        _print_json(found)
    else:
        report.show_devices(found)


@app.command()
def sample(
    folder: Annotated[str, typer.Argument(metavar="DIR", help="Folder to copy into.")],
) -> None:
    """Copy the sample outfit and its characters."""
    from .sample import copy_sample

    written = copy_sample(folder)
    target = Path(folder)
    print(f"{len(written)} files in {target}. Try:")
    print(
        f"  dressform fit {target / 'outfits/casual_woman.usda'} "
        f"{target / 'characters/heavy_woman.usdc'} -o {target / 'dressed.usda'}"
    )


@app.command()
def preview(
    stage: Annotated[str, typer.Argument(metavar="OUT", help="Dressed stage, or an outfit.")],
    out: Annotated[str, typer.Option("-o", "--out", help="Picture: .png; with --pattern also .svg, .pdf.")],
    pattern: Annotated[bool, typer.Option("--pattern", help="Draw the panels, one file a garment.")] = False,
    garment: Annotated[
        list[str] | None, typer.Option(help="Only the garment of that name; repeatable.")
    ] = None,
    close: Annotated[bool, typer.Option("--close", help="Frame the garments, not the body.")] = False,
) -> None:
    """Draw contact sheets: by panel, strain and distance, from front, side and back."""
    from .preview.stage import draw_stage

    for path in draw_stage(stage, out, pattern=pattern, names=garment or [], close=close):
        print(path)


@app.command()
def version() -> None:
    """Print the version."""
    from . import _native

    print(_native.version)


if __name__ == "__main__":
    main()
