"""The working tree, copied for a build of its own: for scripts/mutants and scripts/choices."""

import pathlib
import shutil
import subprocess


def copy_tree(root: pathlib.Path, tree: pathlib.Path) -> None:
    """Copies files whose content differs, so that nothing else is built anew, and removes what is gone."""
    names = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=root, check=True, capture_output=True, text=True,
    ).stdout.split("\0")
    names = {name for name in names if name and (root / name).is_file()}
    for name in names:
        source, copy = root / name, tree / name
        if not copy.is_file() or copy.read_bytes() != source.read_bytes():
            copy.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(source, copy)
            shutil.copymode(source, copy)
    for copy in tree.rglob("*"):
        if copy.is_file() and str(copy.relative_to(tree)) not in names:
            copy.unlink()
