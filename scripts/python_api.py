#!/usr/bin/env python3
"""Prints docs/python-api.md: each function, class and member of the installed package `hemicube`, from its own documentation.

  PYTHON scripts/python_api.py > docs/python-api.md
"""

import inspect
import re
import textwrap

import hemicube

HEAD = """# Python API

Made by `scripts/python_api.py` from the package's documentation; `help(hemicube.compute)` shows the same. A tutorial is in [From
Python](python.md).
"""


def prose(thing):
    """Documentation as Markdown: references of Sphinx as code, examples left out."""
    text = inspect.getdoc(thing) or ""
    text = re.sub(r"\n *>>> .*?(?=\n\n|\Z)", "", text, flags=re.S)
    # Between backticks Markdown takes text as it is.
    pieces = text.strip().split("`")
    pieces[::2] = [re.sub(r"([*_<])", r"\\\1", piece) for piece in pieces[::2]]
    return "`".join(pieces)


def signature(name, thing):
    """`name(…)` with defaults and without annotations, which the stubs have; what has no signature is its name."""
    try:
        found = inspect.signature(thing)
    except (TypeError, ValueError):
        return name
    hidden = ("self", "cls", "$cls", "$self")
    parameters = [p.replace(annotation=p.empty) for p in found.parameters.values() if p.name not in hidden]
    parameters = [p.replace(kind=p.POSITIONAL_OR_KEYWORD) if p.kind == p.POSITIONAL_ONLY else p for p in parameters]
    text = name + str(inspect.Signature(parameters)).replace("Ellipsis", "...")
    return text


def first_sentence(thing):
    text = " ".join(prose(thing).split("\n\n")[0].split())
    return re.split(r"(?<=[.!?])\s+(?=[A-Z])", text)[0].replace("|", "\\|")


def members(thing):
    """Lines of a table: public attributes and methods."""
    for name, member in vars(thing).items():
        if name.startswith("_"):
            continue
        member = member.__func__ if isinstance(member, (classmethod, staticmethod)) else member
        written = signature(name, member) if callable(member) else name
        yield f"| `{written}` | {first_sentence(member)} |"


def page():
    """The text of the page."""
    names = [name for name in hemicube.__all__ if not name.startswith("__")]
    things = {name: getattr(hemicube, name) for name in names}
    functions = {name: thing for name, thing in things.items() if not inspect.isclass(thing) and callable(thing)}
    errors = {name: thing for name, thing in things.items() if inspect.isclass(thing) and issubclass(thing, Exception)}
    classes = {name: thing for name, thing in things.items() if inspect.isclass(thing) and name not in errors}
    parts = [HEAD, "\n## Functions\n"]
    for name, thing in sorted(functions.items()):
        written = textwrap.fill(f"hemicube.{signature(name, thing)}", 100, subsequent_indent="    ", break_on_hyphens=False)
        parts.append(f"\n### {name}\n\n```text\n{written}\n```\n\n{prose(thing)}\n")
    parts.append("\n## Classes\n")
    for name, thing in sorted(classes.items()):
        lines = sorted(members(thing))
        parts.append(f"\n### {name}\n\n{prose(thing)}\n")
        if lines:
            parts.append("\n| member | meaning |\n|---|---|\n" + "\n".join(lines) + "\n")
    parts.append("\n## Errors\n\n| error | meaning |\n|---|---|\n")
    parts += [f"| `{name}` | {first_sentence(thing)} |\n" for name, thing in sorted(errors.items())]
    constants = {name: thing for name, thing in things.items() if isinstance(thing, float)}
    parts.append("\n## Constants\n\n")
    parts += [f"`hemicube.{name}` = {value!r}\n" for name, value in sorted(constants.items())]
    return "".join(parts)


if __name__ == "__main__":
    print(page(), end="")
