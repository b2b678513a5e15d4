"""The process that fuses."""

from service.processes.worker import Worker


def fusion_process() -> Worker:
    """Not started; importing what it needs takes it longer than anything else that has to be made ready."""
    return Worker("fusion process", "service.fusion.answering:answering")
