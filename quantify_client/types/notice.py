"""A warning: a code for programs, a sentence for people, and the numbers in it."""

from __future__ import annotations

from typing import Any, Mapping

__all__ = ["Notice"]


class Notice(str):
    """A sentence in plain English and metric units, with a code and the values it was made of.

    It is a ``str``, so whoever only shows warnings needs to know nothing else. In JSON it is
    ``{"code", "text", "values"}``, so that a program, or another language, can word it anew.

    Parameters
    ----------
    code : lower-case words joined by hyphens, the same for all warnings of a kind
        (``"gaps-interpolated"``).
    text : the sentence.
    **values : what the sentence tells, by name and SI unit (``share=0.69``, ``height_m=2.5``).

    Examples
    --------
    >>> gaps = Notice("gaps-interpolated", "points support 69% of the area", share=0.69)
    >>> gaps, gaps.code, gaps.values
    ('points support 69% of the area', 'gaps-interpolated', {'share': 0.69})
    """

    code: str
    values: Mapping[str, Any]

    def __new__(cls, code: str, text: str, **values: Any) -> Notice:
        """Return the sentence with its code and values."""
        return cls.of(code, text, values)

    @classmethod
    def of(cls, code: str, text: str, values: Mapping[str, Any]) -> Notice:
        """Return the same, of values with any names."""
        notice = super().__new__(cls, text)
        notice.code, notice.values = code, values
        return notice

    def __reduce__(self) -> Any:
        """Keep code and values when the warning goes to another process or is copied."""
        return Notice.of, (self.code, str(self), dict(self.values))
