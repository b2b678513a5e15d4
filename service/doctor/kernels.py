"""The compiled kernels: without them the first map takes minutes."""

from __future__ import annotations

import sys
from collections.abc import Iterator

from service.config.sections import Configuration
from service.doctor.check import Check

WARM_UP = f'{sys.executable} -c "from solver.warming import warm_up; warm_up()"'


def check_kernels(_: Configuration) -> Iterator[Check]:
    """Do the fusion's kernels lie compiled, and can those be kept that do not?"""
    from solver.runtime.survey import survey

    found = survey()
    if found.folder is None:
        finding = "nothing is compiled at all: fusing takes hundreds of times as long"
        yield Check(name="kernels", state="problem", finding=finding, remedy="unset NUMBA_DISABLE_JIT")
        return
    said = f"{found.compiled} of {found.kernels} kernels lie compiled in {found.folder}"
    if found.fault is not None:
        yield Check(
            name="kernels",
            state="warning",
            finding=f"{said}; others cannot be kept, every start compiles them anew ({found.fault})",
            remedy="name a folder of this user's own: export NUMBA_CACHE_DIR=/var/cache/lidarboost",
        )
    elif not found.compiled:
        yield Check(
            name="kernels",
            state="warning",
            finding=f"{said}: the first map takes minutes, as they are compiled",
            remedy=WARM_UP,
        )
    else:
        yield Check(name="kernels", state="ok", finding=f"{said}; others are kept when they are compiled")
