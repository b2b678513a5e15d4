"""What can go wrong in a fusion, as types."""


class FusionError(Exception):
    """Root of every error that the solver raises on purpose."""


class FusionInputError(FusionError, ValueError):
    """The arrays or options given cannot be fused; the message says what was given and what was expected."""


class RegistrationError(FusionError):
    """No frame could be aligned with the reference."""


class FusionWarning(UserWarning):
    """The result is usable, but less than what was asked for (for example: not converged)."""
