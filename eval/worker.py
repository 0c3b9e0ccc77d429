"""Worker processes; see :mod:`integ_gym.train.worker`."""

from integ_gym.train.worker import Progress, report_work

__all__ = ["Progress", "report_work"]
