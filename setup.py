"""Build steps beyond pyproject.toml: packages carry the commit they were built from, and need no symbolic links."""

import runpy
from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py
from setuptools.command.sdist import sdist

ROOT = Path(__file__).resolve().parent
versions = runpy.run_path(str(ROOT / "ifrdem" / "tools" / "versions.py"))


def _store_commit(folder: str) -> None:
    path = Path(folder) / versions["COMMIT_FILE"]
    path.unlink()  # of an sdist, it may be a hard link to the file in the tree
    path.write_text(versions["revision"]() + "\n", encoding="utf-8")


class BuildWithCommit(build_py):
    def finalize_options(self):
        super().finalize_options()
        # Where git writes symbolic links as text files (Windows), modules are taken from where the links lead.
        for folder in ("kernels", "validation", "cases"):
            if not (ROOT / "ifrdem" / folder).is_dir():
                self.package_dir[f"ifrdem.{folder}"] = folder

    def run(self):
        super().run()
        if not self.editable_mode:  # which reads the tree, and asks its git
            _store_commit(self.build_lib)


class SourceWithCommit(sdist):
    def make_release_tree(self, base_dir, files):
        super().make_release_tree(base_dir, files)
        _store_commit(base_dir)


setup(cmdclass={"build_py": BuildWithCommit, "sdist": SourceWithCommit})
