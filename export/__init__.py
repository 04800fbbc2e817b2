"""Flights and controllers in file formats of other programs, as text and bytes.

    paths          positions of a vehicle over time, and an origin on the earth
    pieces         polynomials over windows of time, with their largest error
    crazyswarm     CSV of polynomials of degree 7
    skybrush       .skyc, a show of Bezier curves
    ros            a bag of ROS 2 in MCAP
    missions       .plan of QGroundControl, and waypoints as text: no times
    tables         CSV with units
    controller     a receding-horizon controller in C99

No file of a user is read or written here.
"""

# ruff: noqa: I001  (it would write one statement for each name)
from typing import TYPE_CHECKING

from swarmstart.doors import door

if TYPE_CHECKING:  # Loaded when first used: a trajectory needs no compiler.
    from swarmstart.export.controller.exported import (
        CExport as CExport,
        CompiledController as CompiledController,
        NoCCompilerError as NoCCompilerError,
    )
    from swarmstart.export.controller.files import (
        export_c as export_c,
        require_name as require_name,
    )
    from swarmstart.export.controller.fmu import (
        export_fmu as export_fmu,
        is_compiled as is_compiled,
    )
    from swarmstart.export.crazyswarm import (
        crazyswarm_text as crazyswarm_text,
    )
    from swarmstart.export.missions import (
        plan_text as plan_text,
        waypoints_text as waypoints_text,
    )
    from swarmstart.export.paths import (
        AXES as AXES,
        ExportError as ExportError,
        Origin as Origin,
        VehiclePath as VehiclePath,
    )
    from swarmstart.export.ros import (
        mcap_bytes as mcap_bytes,
    )
    from swarmstart.export.skybrush import (
        skybrush_bytes as skybrush_bytes,
    )
    from swarmstart.export.tables import (
        table_text as table_text,
    )

_NAMES = {
    "controller.exported": "CExport CompiledController NoCCompilerError",
    "controller.files": "export_c require_name",
    "controller.fmu": "export_fmu is_compiled",
    "crazyswarm": "crazyswarm_text",
    "missions": "plan_text waypoints_text",
    "paths": "AXES ExportError Origin VehiclePath",
    "ros": "mcap_bytes",
    "skybrush": "skybrush_bytes",
    "tables": "table_text",
}
_HOMES, __getattr__, __dir__ = door(__name__, _NAMES)
__all__ = list(_HOMES)
