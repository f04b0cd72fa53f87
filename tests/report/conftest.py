from __future__ import annotations

import pytest


def pytest_configure(config: pytest.Config) -> None:
    # matplotlib 3.9, the last for Python 3.9, calls names that pyparsing 3.3 has renamed.
    for module in ("matplotlib._fontconfig_pattern", "matplotlib._mathtext"):
        config.addinivalue_line("filterwarnings", f"ignore::DeprecationWarning:{module}")
