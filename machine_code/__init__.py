"""Machine code: kernels compiled by Numba or LLVM, and the cache that stores them.

This package knows nothing of what the kernels compute. A file of the cache is used only
if it belongs to this user; its key covers the code, the libraries and the processor.
"""

# ruff: noqa: I001  (it would write one statement for each name)
from typing import TYPE_CHECKING

from swarmstart.doors import door

if TYPE_CHECKING:  # Loaded when first used: kernels need NumPy, the clock does not.
    from swarmstart.machine_code.clocks import (
        Stopwatch as Stopwatch,
        WorkClock as WorkClock,
        compiling as compiling,
        done as done,
        held_while_compiling as held_while_compiling,
        now as now,
        stopwatch as stopwatch,
        working as working,
    )
    from swarmstart.machine_code.code_cache import (
        LIMIT_BYTES as LIMIT_BYTES,
        cache_refusal as cache_refusal,
        cache_usage as cache_usage,
        clear_cache as clear_cache,
        load_code as load_code,
        store_code as store_code,
    )
    from swarmstart.machine_code.fingerprints import (
        source as source,
        sources as sources,
    )
    from swarmstart.machine_code.kernels import (
        Count as Count,
        Pointers as Pointers,
        address_of as address_of,
        call_at as call_at,
        call_code as call_code,
        free_kernel as free_kernel,
        ieee_kernel as ieee_kernel,
        is_kept as is_kept,
        is_kernel as is_kernel,
        kernel as kernel,
        prepare as prepare,
    )

_NAMES = {
    "code_cache": """
        LIMIT_BYTES cache_refusal cache_usage clear_cache load_code store_code
    """,
    "clocks": """
        Stopwatch WorkClock compiling done held_while_compiling now stopwatch working
    """,
    "fingerprints": "source sources",
    "kernels": """
        Count Pointers address_of call_at call_code free_kernel ieee_kernel is_kept
        is_kernel kernel prepare
    """,
}
_HOMES, __getattr__, __dir__ = door(__name__, _NAMES)
__all__ = list(_HOMES)
