"""Twelve colours, dashes and marks that tell twelve solvers apart, in light and dark.

The colours are the outcome of a search (simulated annealing over lightness, chroma and
hue) for the twelve whose least distance in OKLab is greatest, as seen with full colour
vision and with protanopia, deuteranopia and tritanopia, each at least 3:1 against the
page; the colours of the dark page have the hues of those of the light page. The first
colours differ most. Twelve colours alone cannot be told apart by every reader, nor in
grey print: hence dashes and marks.

Sources: Ottosson (2020), "A perceptual color space for image processing" (OKLab);
Machado, Oliveira and Fernandes (2009), "A physiologically-based model for simulation of
color vision deficiency"; WCAG 2.2, success criteria 1.4.3 and 1.4.11 (contrast).
"""

LIGHT = (
    "#588ef6", "#f25905", "#640e93", "#3b7070", "#720300", "#914900",
    "#1b0365", "#064753", "#bd51ae", "#9b8a7c", "#8a00ea", "#40022c",
)  # fmt: skip
DARK = (
    "#70a8fc", "#cc7b40", "#a21bdd", "#ddfdf7", "#b54a44", "#ffa82f",
    "#c2ccfb", "#327e8a", "#b4a5af", "#ffccb0", "#8e76d1", "#ec008c",
)  # fmt: skip
DASHES = ("", "7 3", "2 2", "8 2 2 2", "12 3", "4 2 1 2", "1 3", "10 2 2 2 2 2",
          "5 5", "14 2 4 2", "3 2 3 5", "9 4 1 4")  # fmt: skip
MARKS = (
    "m-4 0a4 4 0 1 0 8 0a4 4 0 1 0-8 0z",  # disc
    "m-4-4h8v8h-8z",  # square
    "m0-4l4 8h-8z",  # triangle
    "m0 4l4-8h-8z",  # triangle, point down
    "m0-5l5 5l-5 5l-5-5z",  # diamond
    "m-1.5-4.5h3v3h3v3h-3v3h-3v-3h-3v-3h3z",  # plus
    "m-4 0l8-4v8z",  # triangle, point left
    "m4 0l-8-4v8z",  # triangle, point right
    "m0-5l1.4 3.1l3.4.4l-2.5 2.3l.7 3.4l-3-1.8l-3 1.8l.7-3.4l-2.5-2.3l3.4-.4z",  # star
    "m-4.5-1.7h9v3.4h-9z",  # bar
    "m-1.7-4.5h3.4v9h-3.4z",  # bar, upright
    "m-4-4l8 8v-8l-8 8z",  # hourglass
)
"""Paths of SVG from the place of a mark, about 8 units across."""

# Of the page: ground and text, marks of quality, lines. Contrast of text at
# least 4.5:1, of the border of something to press 3:1.
LIGHT_PAGE = {
    "ground": "#ffffff", "raised": "#f3f5f7", "ink": "#16191d", "ink-soft": "#545c66",
    "rule": "#d9dee3", "line": "#7d8793", "accent": "#0a58b8",
    "good": "#17692f", "bad": "#b3211a", "mid": "#7a5000",
}  # fmt: skip
DARK_PAGE = {
    "ground": "#15181d", "raised": "#20252c", "ink": "#e8eaed", "ink-soft": "#a8b0ba",
    "rule": "#343b44", "line": "#7d8793", "accent": "#82b7ff",
    "good": "#5fcf80", "bad": "#ff9488", "mid": "#e6b94c",
}  # fmt: skip


def style_sheet() -> str:
    """Return the CSS of the colours, for light pages, dark pages and print.

    A page is dark if its `data-theme` is dark, or if the system prefers dark and its
    `data-theme` is not light. Class `s3` sets `stroke` (for lines) and `fill` (for
    marks) to the fourth colour; class `d3` sets the fourth pattern of dashes.
    """
    light = _variables(LIGHT_PAGE, LIGHT)
    dark = _variables(DARK_PAGE, DARK)
    rules = [
        f":root{{color-scheme:light;{light}}}",
        "@media (prefers-color-scheme:dark){:root:not([data-theme=light])"
        f"{{color-scheme:dark;{dark}}}}}",
        f":root[data-theme=dark]{{color-scheme:dark;{dark}}}",
        f"@media print{{:root:root{{color-scheme:light;{light}}}}}",
    ]
    rules += [
        f".s{k}{{stroke:var(--s{k});fill:var(--s{k})}}"
        f".d{k}{{stroke-dasharray:{dash or 'none'}}}"
        for k, dash in enumerate(DASHES)
    ]
    return "\n".join(rules) + "\n"


def _variables(page: dict[str, str], solvers: tuple[str, ...]) -> str:
    named = [f"--{name}:{colour}" for name, colour in page.items()]
    return ";".join(named + [f"--s{k}:{colour}" for k, colour in enumerate(solvers)])
