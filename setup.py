"""Packaging beyond pyproject.toml: the WebODM plugin's files travel inside the package."""

import shutil
from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py

ROOT = Path(__file__).parent


class BuildWithPlugin(build_py):
    """Copies what `quantify-client plugin` makes its zip from; a checkout has it beside itself."""

    def run(self):
        """Build the package, then add the plugin to it."""
        super().run()
        if getattr(self, "editable_mode", False):
            return
        target = Path(self.build_lib) / "quantify_client" / "plugin_files"
        shutil.rmtree(target, ignore_errors=True)
        left_out = shutil.ignore_patterns("__pycache__", "*.pyc", "panel", "node_modules", ".*")
        shutil.copytree(ROOT / "plugin", target / "plugin", ignore=left_out)
        shutil.copy(ROOT / "manifest.json", target)


setup(cmdclass={"build_py": BuildWithPlugin})
