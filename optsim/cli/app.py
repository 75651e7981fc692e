"""The verbs, loaded only when called, and the exit codes: 0 done, 1 the work failed, 2 bad usage or input, 130 Ctrl-C."""

from __future__ import annotations

import os
import re
import sys
import warnings
from collections.abc import Sequence
from typing import TextIO

import cyclopts

from optsim import __version__
from optsim.cli.help import HELP, HELPS

INTERRUPTED = 130
"""Exit code after Ctrl-C, as shells have it."""

TRACEBACK = "OPTSIM_TRACEBACK"
"""Environment variable: set, errors and warnings come with their place in the code."""

VERBS = {
    "run": "optsim.cli.run:run",
    "render": "optsim.cli.render:render",
    "measure": "optsim.cli.measure:measure",
    "reconstruct": "optsim.cli.stages:reconstruct",
    "score": "optsim.cli.stages:score",
    "study": "optsim.cli.study:app",
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
    """Run one verb and leave with its exit code; warnings are told as sentences."""
    if not os.environ.get(TRACEBACK):
        warnings.showwarning = _warn
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

            if os.environ.get(TRACEBACK):
                traceback.print_exc()
            _complain(f"{type(error).__name__}: {error}\n(set {TRACEBACK}=1 for the place)")
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
    """Return what is wrong with the words, without the exit code that cyclopts' own printing would use."""
    text = str(error).strip()
    if isinstance(error, cyclopts.MissingArgumentError) and error.keyword is None:
        text = _missing(error) or text
    return f"{text}\n(optsim --help lists the verbs, optsim VERB --help its options)"


def _missing(error: cyclopts.MissingArgumentError) -> str | None:
    """Say what a verb needs, by the name that is typed (``-o`` before ``--output``); None where cyclopts says it better."""
    if error.argument is None or not error.argument.required:
        return None
    short, *longer = sorted(error.argument.names, key=len)
    names = f"{short} ({', '.join(longer)})" if longer else short
    hint = re.search(" Did you mean .*", str(error))
    return f"{' '.join(error.command_chain or ())} needs {names}: {error.argument.parameter.help}{hint.group() if hint else ''}"


def _warn(
    message: Warning | str, category: type[Warning], filename: str, lineno: int, file: TextIO | None = None, line: str | None = None
) -> None:
    """Print a warning without the place in the code that Python puts before it."""
    print(f"optsim: warning: {message}", file=sys.stderr)


def _complain(text: str) -> None:
    print(f"optsim: {text}", file=sys.stderr)
