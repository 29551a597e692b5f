"""Errors: one base class; every message says what is wrong, where, and the way out."""

from __future__ import annotations


class SemSfmError(Exception):
    """Base of all errors raised on purpose. `exit_code` is what the command line returns."""

    exit_code = 1


class InputError(SemSfmError):
    """The data given do not allow the step: a bad file, too few images, no overlap."""


class UsageError(SemSfmError):
    """The call is wrong: an unknown option, contradictory flags, an unwritable output."""

    exit_code = 2


class DiskFullError(UsageError):
    """There is no space left for what is written. Nothing is wrong with the data: what was finished
    is kept, and the same command goes on where there is space.
    """


class ClusterError(SemSfmError):
    """The processes that work was sent to are gone. Nothing is wrong with the data: what was
    finished is kept, and the same command goes on.
    """


class MissingDependencyError(SemSfmError):
    """A library or a system package that a step needs is not installed."""

    exit_code = 2
