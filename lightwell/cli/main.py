"""The command ``lightwell``. Only the module of the given verb is imported, so that help is printed at once."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from time import perf_counter

import lightwell
from lightwell.cli.interrupts import INTERRUPTED, Interrupts
from lightwell.cli.parser import USAGE_ERROR, Parser
from lightwell.cli.verbs import COMPUTING, GO_ON, GROUPS, RESUMABLE, SERVERS, VERBS
from lightwell.core.suggest import did_you_mean

EXAMPLES = """\
examples
  lightwell demo                                     the main job on a built-in scene
  lightwell bake room.glb -o out                     learn the light of your scene, three minutes
  lightwell bake room.glb -o out --budget 10m        ... better, in ten minutes
  lightwell bake room.glb -o out --quality best      ... best, in twenty
  lightwell bake room.glb -o out --budget 5%         ... until the error is five per cent
  lightwell bake cornell -o out --vary "light.position=box(-0.8,0.2,-0.8,0.8,1.8,0.8)"
  lightwell bake house.xml -o out --vary "sun.direction=arc(90,10,270,10)"
  lightwell bake room.glb -o out --field lightmap --size 2048
  lightwell view out                                 open the page
  lightwell lens frame.exr -o out.exr --focus 2.5m --fstop 1.8 --focal 50mm    depth of field and motion blur
  lightwell compare out-a out-b                      two bakes side by side
  lightwell compare --fields mlp,factored cornell -o fields    train fields on the same samples and compare them
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Run one verb. A mistake of the user is one line on standard error and exit code 2, without a traceback.

    Args:
        argv: Words after ``lightwell``; None: those of this process.

    Returns:
        The exit code: 0, 1 where a check found something, 2 for a mistake, 130 after Ctrl-C.

    Raises:
        Exception: A defect of lightwell, with its traceback.
    """
    try:
        return _main([str(word) for word in (sys.argv[1:] if argv is None else argv)])
    finally:
        _drop_output()


def _main(words: list[str]) -> int:
    verb = words[0] if words and words[0] in VERBS else ""
    arguments = argparse.Namespace(verb=verb, started=perf_counter(), typed=tuple(words[1:]))
    interrupts = Interrupts()
    try:
        with interrupts:
            if not verb:
                return _without_verb(words)
            from lightwell.cli.early import check_arguments
            from lightwell.cli.this_machine import apply_machine_options, logged

            module = import_module(f"lightwell.cli.{verb}")
            told = _configured(verb, words[1:])
            verb_parser(verb, told).parse_args(told, arguments)
            with logged(getattr(arguments, "log", None), words):
                check_arguments(arguments)
                apply_machine_options(arguments)
                code: int = module.run(arguments)
            if sys.stdout is not None:
                sys.stdout.flush()  # Here a full disk is still an error of one line.
            return code
    except KeyboardInterrupt:
        return _interrupted(arguments)
    except BrokenPipeError:
        return 0  # The reader has seen enough (``| head``).
    except Exception as error:
        if interrupts.received:
            return _interrupted(arguments)
        if not isinstance(error, (ValueError, OSError, RuntimeError, MemoryError)):
            raise
        print(f"lightwell: {_one_line(error)}", file=sys.stderr)
        return USAGE_ERROR


def _drop_output() -> None:
    """Drop what standard output still holds and cannot write: the interpreter would complain at its end (code 120)."""
    if getattr(sys.stdout, "closed", True):
        return
    try:
        sys.stdout.flush()
    except OSError:
        with open(os.devnull, "w") as nothing:
            os.dup2(nothing.fileno(), sys.stdout.fileno())


def _configured(verb: str, words: list[str]) -> list[str]:
    """The words of a verb that computes, with the options of ``lightwell.toml``; tools of a verb have none."""
    tools = getattr(import_module(f"lightwell.cli.{verb}"), "TOOLS", ())
    if verb not in COMPUTING or set(tools) & set(words):
        return words
    from lightwell.cli.configuration import with_configuration

    return with_configuration(verb, words, verb_parser)


def verb_parser(verb: str, argv: Sequence[str] = ()) -> Parser:
    """Make the parser of a verb.

    Args:
        verb: Name of the verb.
        argv: Words after the verb; the arguments of some verbs depend on them.

    Returns:
        The parser.
    """
    module = import_module(f"lightwell.cli.{verb}")
    parser = Parser(
        prog=f"lightwell {verb}",
        description=getattr(module, "DESCRIPTION", VERBS[verb]),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    module.add(parser, argv)
    if verb in COMPUTING:
        from lightwell.cli.configuration import add_config_option
        from lightwell.cli.this_machine import add_machine_options

        group = add_machine_options(parser)
        if not set(getattr(module, "TOOLS", ())) & set(argv):  # Tools of a verb read no settings.
            add_config_option(group)
    return parser


def _without_verb(words: Sequence[str]) -> int:
    """Print what to do next, help or the version; report an unknown verb."""
    if not words:
        from lightwell.cli.next_steps import next_steps

        print(next_steps(Path.cwd()))
        return 0
    if not words[0].startswith("-"):
        cure = did_you_mean(words[0], VERBS, f"choose one of {', '.join(VERBS)}")
        raise ValueError(f"there is no verb '{words[0]}'; {cure}")
    parser = Parser(
        prog="lightwell",
        usage="lightwell VERB [arguments]",
        description=f"Learns the indirect light of a scene and plays it back in real time.\n\n{_verbs_in_groups()}",
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"lightwell {lightwell.__version__}")
    parser.parse_args(words)
    return 0


def _verbs_in_groups() -> str:
    lines = []
    for title, verbs in GROUPS.items():
        lines += [f"{title}:", *(f"  {verb:<11}{VERBS[verb]}" for verb in verbs), ""]
    return "\n".join(lines).rstrip()


def _interrupted(arguments: argparse.Namespace) -> int:
    """Print how to continue after an interrupt."""
    if arguments.verb and arguments.verb not in SERVERS:
        long = arguments.verb in RESUMABLE or getattr(arguments, "fields", None)
        resume = f"; the checkpoint is kept, go on with {GO_ON.get(arguments.verb, '--resume')}" if long else ""
        print(f"lightwell: interrupted{resume}", file=sys.stderr)
    return INTERRUPTED


def _one_line(error: BaseException) -> str:
    """Describe an error in one line; for lack of memory and some errors of the operating system with the cure."""
    text = " ".join(str(error).split()) or type(error).__name__
    if isinstance(error, MemoryError):
        what = "" if text in ("MemoryError", "std::bad_alloc") else f" ({text[:200]})"
        return f"needs more memory than this machine has{what}; choose a smaller scene, picture or preset"
    if isinstance(error, OSError) and text.startswith("[Errno"):
        if (said := str(error.strerror)).startswith("cannot "):
            return said  # ``files.explained`` has named the file and the cure.
        from lightwell.files import CURES

        cure = CURES.get(error.errno or 0, "")
        return f"{error.strerror}: {error.filename or 'output'}{'; ' + cure if cure else ''}"
    return text
