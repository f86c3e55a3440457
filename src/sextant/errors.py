"""Exceptions that are told to the user in one message."""


class UserError(Exception):
    """A mistake that the user can mend; commands print it as one message, never as a traceback.

    Args:
        problem: what is wrong, naming the key or file, the value, and what is allowed.
        fix: what to do about it, if possible something to paste.
    """

    def __init__(self, problem: str, fix: str | None = None):
        self.problem = problem
        self.fix = fix
        super().__init__(problem if fix is None else f"{problem}\n{fix}")

    def __reduce__(self) -> tuple[type["UserError"], tuple[str, str | None]]:
        return type(self), (self.problem, self.fix)


class LossNotFiniteError(UserError):
    """The training loss became infinite or not a number: going on would only spoil the weights."""

    @classmethod
    def at(cls, step: int, value: float) -> "LossNotFiniteError":
        """The error for a loss of ``value`` at ``step``."""
        return cls(
            f"the training loss became {value} at step {step}, and the run was stopped",
            "Lower optimizer.lr, or look at the data; the checkpoint of the last whole epoch is kept.",
        )
