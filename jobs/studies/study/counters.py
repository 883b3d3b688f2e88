"""Counters of the processor's caches, read by Linux' perf_event_open over child processes and all that they start."""
import ctypes
import errno
import math
import os
import struct

# perf_event_attr.type, .config: references to the last level and those that missed, reads of the first level's data
# cache and those that missed.
CACHES = {'cache_references': (0, 2), 'cache_misses': (0, 3), 'l1d_reads': (3, 0), 'l1d_read_misses': (3, 1 << 16)}
TASK_CLOCK = (1, 1)  # ns of the processor: the kernel's own, for tests
_CALL = {'x86_64': 298, 'aarch64': 241, 'ppc64le': 319, 'riscv64': 241}.get(os.uname().machine)
_INHERIT, _NO_KERNEL, _NO_HYPERVISOR, _CLOSE_ON_EXEC = 1 << 1, 1 << 5, 1 << 6, 8
_TIMES = 3  # read_format: the count, ns in which it was wanted, ns in which it was counted


def _open(kind, config):
    """A descriptor, or below 0 the number of the error. Counts user code only: the kernel's own may be counted by few.
    """
    if _CALL is None:
        return -errno.ENOSYS
    flags = _INHERIT | _NO_KERNEL | _NO_HYPERVISOR
    attributes = struct.pack('<IIQQQQQ', kind, 112, config, 0, 0, _TIMES, flags).ljust(112, b'\0')
    call = ctypes.CDLL(None, use_errno=True).syscall
    found = call(ctypes.c_long(_CALL), attributes, ctypes.c_int(0), ctypes.c_int(-1), ctypes.c_int(-1),
                 ctypes.c_ulong(_CLOSE_ON_EXEC))
    return found if found >= 0 else -ctypes.get_errno()


class Counters:
    """Counts in this thread and in the processes that it starts from now on."""

    def __init__(self, which=tuple(CACHES.values())):
        self.files = [_open(*counter) for counter in which]
        self.why = next((-file for file in self.files if file < 0), 0)

    def read(self):
        """The counts so far, of processes that have ended. Where the processor has fewer counters than were asked for,
        the kernel counted each for a part of the time, and the value is scaled up; NaN: it could not be counted."""
        values = []
        for file in self.files:
            count, wanted, counted = struct.unpack('<QQQ', os.read(file, 24)) if file >= 0 else (0, 0, 0)
            values.append(count * (wanted / counted) if counted > 0 else math.nan)
        return values

    def close(self):
        for file in self.files:
            if file >= 0:
                os.close(file)
        self.files = []


def remedy(why):
    """The sentence for an error of Counters.why."""
    if why in (errno.EACCES, errno.EPERM):
        return ("cache misses were not counted, for this system does not permit it: 'sysctl "
                "kernel.perf_event_paranoid=2' permits it, and a container must also be allowed to call "
                "perf_event_open")
    if why in (errno.ENOENT, errno.EOPNOTSUPP, errno.ENODEV):
        return ("not all cache misses were counted, for the processor shows no such counters here: a virtual machine "
                "must pass them on, or measure on the machine itself")
    if why == errno.ENOSYS:
        return ("cache misses were not counted, for this system has no perf_event_open: a container must be allowed to "
                "call it")
    return ("not all cache misses were counted, for perf_event_open failed: too many open files, or another program "
            "has the counters")
