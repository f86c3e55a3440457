"""Many problems in one message."""

from collections.abc import Sequence

#: problems that a message names
NAMED = 20


def problem_list(problems: Sequence[str]) -> str:
    """The first problems, one per line, and how many more there are."""
    lines = "\n".join(f"  {problem}" for problem in problems[:NAMED])
    more = len(problems) - NAMED
    return f"{lines}\n  and {more:,} more" if more > 0 else lines
