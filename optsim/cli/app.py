"""The verbs, loaded only when called, and the exit codes: 0 done, 1 the work failed, 2 bad usage or input, 130 Ctrl-C."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence

import cyclopts

from optsim import __version__
from optsim.cli.help import HELP, HELPS

INTERRUPTED = 130
"""Exit code after Ctrl-C, as shells have it."""

VERBS = {
    "run": "optsim.cli.run:run",
    "render": "optsim.cli.render:render",
    "measure": "optsim.cli.measure:measure",
    "reconstruct": "optsim.cli.stages:reconstruct",
    "score": "optsim.cli.stages:score",
    "import": "optsim.cli.data:import_cube",
    "import-measurement": "optsim.cli.data:import_measurement",
    "export": "optsim.cli.data:export",
    "prism": "optsim.cli.prism:prism",
    "calibrate": "optsim.cli.calibrate:calibrate",
    "camera": "optsim.cli.camera:camera",
    "explain": "optsim.cli.explain:explain",
    "doctor": "optsim.cli.questions:doctor",
    "scenes": "optsim.cli.questions:scenes",
    "show": "optsim.cli.questions:show",
}


def build() -> cyclopts.App:
    """Return the application with its verbs as import paths, so that ``--help`` loads none of them."""
    app = cyclopts.App(name="optsim", help=HELP, help_format="markdown", version=__version__, suppress_keyboard_interrupt=False)
    for name, path in VERBS.items():
        app.command(path, name=name, help=HELPS[name])
    return app


def main(arguments: Sequence[str] | None = None) -> None:
    """Run one verb and leave with its exit code."""
    sys.exit(_code(list(sys.argv[1:] if arguments is None else arguments)))


def _code(arguments: list[str]) -> int:
    app = build()
    try:
        app(arguments, exit_on_error=False, print_error=False, result_action="return_value")
    except cyclopts.CycloptsError as error:
        _complain(_usage(error))
        return 2
    except KeyboardInterrupt as interrupt:
        _complain(str(interrupt) or "stopped")
        return INTERRUPTED
    except BrokenPipeError:  # the reader of our output left, as `head` does
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except SystemExit as leave:
        return leave.code if isinstance(leave.code, int) else 1
    except Exception as error:
        if not _is_input_error(error):
            import traceback

            if os.environ.get("OPTSIM_TRACEBACK"):
                traceback.print_exc()
            _complain(f"{type(error).__name__}: {error}\n(set OPTSIM_TRACEBACK=1 for the place)")
            return 1
        _complain(_describe(error))
        return 2
    return 0


def _is_input_error(error: Exception) -> bool:
    """Tell whether the user's input was refused: an InputError of any of the three packages, or pydantic's."""
    names = {cls.__name__ for cls in type(error).__mro__}
    return "InputError" in names or ("ValidationError" in names and isinstance(error, ValueError))


def _describe(error: Exception) -> str:
    import pydantic

    if isinstance(error, pydantic.ValidationError):
        return "\n".join(f"{'.'.join(map(str, e['loc'])) or error.title}: {e['msg']}, got {e['input']!r}" for e in error.errors()[:5])
    return str(error)


def _usage(error: cyclopts.CycloptsError) -> str:
    """Return cyclopts' sentence, without the exit code that its own printing would use."""
    return f"{str(error).strip()}\n(optsim --help lists the verbs, optsim VERB --help its options)"


def _complain(text: str) -> None:
    print(f"optsim: {text}", file=sys.stderr)
