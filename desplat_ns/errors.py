"""What a user can get wrong. Each error says what was found, what was needed and what to type."""


class DeSplatError(Exception):
    """A mistake that the user can mend; the commands print its message without a traceback."""


class BackendUnavailableError(DeSplatError):
    """The chosen rasterizer cannot run here."""


class CaptureError(DeSplatError):
    """The capture on disk (photos, reconstruction, split) cannot be used as it is."""


class CheckpointError(DeSplatError):
    """A checkpoint is damaged, or belongs to another scene or to other effects."""


class ConfigError(DeSplatError):
    """Options that contradict each other or lie outside their range."""
