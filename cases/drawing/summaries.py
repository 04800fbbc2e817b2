"""Results as notebooks show them."""

import base64
import html
import io

from swarmstart.ocp import Solution, Trajectory


def html_of(result: Solution | Trajectory) -> str:
    """Return the summary of a result, and its figure beneath."""
    image = io.BytesIO()
    result.plot().savefig(image, format="png")
    encoded = base64.b64encode(image.getvalue()).decode("ascii")
    return (
        f"<pre>{html.escape(repr(result))}</pre>"
        '<img alt="states and controls over time" '
        f'src="data:image/png;base64,{encoded}">'
    )
