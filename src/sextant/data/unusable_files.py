"""The error for an input of which no file could be used."""

from collections.abc import Mapping

from sextant.errors import UserError, problem_list


def nothing_usable(problem: str, skipped: Mapping[str, str], fix: str | None = None) -> UserError:
    """The error for an input of which nothing could be used; its message names the files.

    Args:
        problem: what is wrong with all of them.
        skipped: the reason for each file.
        fix: what to do.
    """
    listed = problem_list([f"{name}: {reason_alone(name, why)}" for name, why in skipped.items()])
    return UserError(f"{problem}\n{listed}", fix or "Replace these files, or name others.")


def reason_alone(name: str, problem: str) -> str:
    """A problem on one line, without the leading name of its file."""
    return " ".join(problem.removeprefix(name).lstrip(":, ").split())
