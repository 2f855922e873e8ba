"""`flexarm completion SHELL`: its options and its output."""

import argparse
from collections.abc import Iterable, Iterator
from typing import Any

from ..run.scene.scene import SCENES
from . import examples, options

SUMMARY = "print a script that completes commands in a shell"
TEXT = (
    "It knows commands, options, shipped scenes and files. Once: 'flexarm completion bash > "
    "~/.local/share/bash-completion/completions/flexarm' (zsh: a file '_flexarm' in a folder of $fpath; fish: "
    "~/.config/fish/completions/flexarm.fish); or for one session: eval \"$(flexarm completion bash)\"."
)
SHELLS = ("bash", "zsh", "fish", "tcsh")


def arguments(p: argparse.ArgumentParser) -> None:
    p.add_argument("shell", metavar="SHELL", choices=SHELLS, help=", ".join(SHELLS))


def _words(name: str, words: Iterable[str], *patterns: str) -> dict[str, Any]:
    """How each shell completes an argument that is one of these words, or, with patterns, a file of these."""
    import shtab

    listed, function = " ".join(words), f"_flexarm_{name}_files"  # of such a name shtab lets folders end with a slash
    bash, zsh, fish, tcsh = f"compgen -W '{listed}' -- \"$1\"; ", f"'{name}:{name}:({listed})'", listed, f"({listed})"
    before: dict[str, str] = {}
    if patterns:
        files: Any = shtab.glob(*patterns)
        before = files["preamble"]
        bash += "".join(f"compgen -f -X '!{x}' -- \"$1\"; " for x in patterns) + 'compgen -d -- "$1"; '
        wanted = patterns[0] if len(patterns) == 1 else f"({'|'.join(patterns)})"  # (*.toml) alone means something else
        zsh += f" 'files:file:_files -g \"{wanted}\"'"
        fish, tcsh = f"{listed} {files['fish']}", files["tcsh"]
    preamble = {
        "bash": f"{function}() {{ {bash}}}\n",
        "zsh": f"{function}() {{ _alternative {zsh}; }}\n",
        "fish": before.get("fish", ""),
    }
    return {"bash": function, "zsh": function, "fish": fish, "tcsh": tcsh, "preamble": preamble}


def _completers() -> dict[str, Any]:
    """By the name that --help has for an argument."""
    import shtab

    scenes, sweeps = (sorted(p.stem for p in folder.glob("*.toml")) for folder in (SCENES, SCENES / "sweeps"))
    return {
        "SCENE": _words("scene", scenes, "*.toml"),
        "SCENE|RUN": _words("run", scenes, "*.toml", "*.npz", "*.h5", "*.hdf5"),
        "SWEEP": _words("sweep", sweeps, "*.toml"),
        "EXAMPLE": _words("example", examples.scripts()),
        "DATA": shtab.FILE,
        "FILE": shtab.FILE,
        "DIR": shtab.DIRECTORY,
    }


def _actions(parser: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    for action in parser._actions:
        yield action
        if isinstance(action, argparse._SubParsersAction):
            for part in action.choices.values():
                yield from _actions(part)


def script(parser: argparse.ArgumentParser, shell: str) -> str:
    """The completion of a parser for a shell."""
    import shtab

    known = _completers()
    for action in _actions(parser):
        if action.metavar in known:
            action.complete = known[action.metavar]  # type: ignore[attr-defined]
        elif isinstance(action.metavar, str) and "|" in action.metavar:  # such as tip|joint|strain
            action.choices = action.metavar.split("|")
    return str(shtab.complete(parser, shell))


def run(args: argparse.Namespace) -> int:
    """Prints the script."""
    text = script(args.top, args.shell)
    options.told(args, {"shell": args.shell, "script": text}, text)
    return 0
