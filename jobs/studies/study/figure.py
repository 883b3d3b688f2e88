"""Figures as SVG, by matplotlib: all studies draw in these colours, sizes and units."""
import io
import logging
import math

COLORS = ['#1f5fa8', '#c4451c', '#3d8b37', '#8a4fb0', '#b08a00', '#555555', '#0f8f9a', '#c23b7a', '#111111']


def _color(index):
    return COLORS[index % len(COLORS)]


def _matplotlib():
    """Loaded when something is drawn: it takes half a second."""
    logging.getLogger('matplotlib').setLevel(logging.ERROR)
    import matplotlib
    matplotlib.use('svg')
    matplotlib.rcParams.update({'svg.fonttype': 'none', 'svg.hashsalt': 'kiln', 'font.size': 9, 'axes.grid': True,
                                'grid.color': '#dddddd', 'font.family': 'sans-serif', 'axes.titlelocation': 'left'})
    from matplotlib.figure import Figure
    return Figure


class Plot:
    """One figure. Values are multiplied by `factors` before they are shown with `units`."""

    def __init__(self, title, across, up, units=('', ''), factors=(1.0, 1.0), logarithmic=True, legend=True):
        self.figure = _matplotlib()(figsize=(8.6, 5.6), layout='constrained')
        self.axes = self.figure.add_subplot()
        self.factors, self.logarithmic, self.legend = factors, logarithmic, legend
        self.axes.set_title(title, parse_math=False)
        self.axes.set_xlabel(across)
        self.axes.set_ylabel(up)
        if logarithmic:
            self.axes.set_xscale('log')
            self.axes.set_yscale('log')
        for axis, unit in ((self.axes.xaxis, units[0]), (self.axes.yaxis, units[1])):
            self._number(axis, unit)

    def _number(self, axis, unit):
        """Numbers with their unit; on logarithmic axes at 1, 2 and 5 times the powers of ten."""
        from matplotlib import ticker
        axis.set_major_formatter(ticker.FuncFormatter(lambda value, _: '%g%s' % (float('%.3g' % value), unit)))
        if self.logarithmic:
            axis.set_major_locator(ticker.LogLocator(subs=(1.0, 2.0, 5.0)))
            axis.set_minor_locator(ticker.NullLocator())

    def scaled(self, points):
        """Points that have a place: finite, and above 0 where an axis is logarithmic; times the factors."""
        return [(x * self.factors[0], y * self.factors[1]) for x, y in points
                if math.isfinite(x) and math.isfinite(y) and (not self.logarithmic or x > 0 and y > 0)]

    def line(self, points, name, color=0, dashed=False, dots=True):
        """Points that are joined, in their order."""
        shown = self.scaled(points)
        self.axes.plot([x for x, _ in shown], [y for _, y in shown], color=_color(color), label=name,
                       linestyle='--' if dashed else '-', marker='o' if dots else None, markersize=5,
                       markerfacecolor='white' if dashed else None)

    def dots(self, points, name=None, color=0, hollow=False, labels=(), size=5):
        """Single points, with their names beside them."""
        shown = self.scaled(points)
        color = color if isinstance(color, str) else _color(color)
        self.axes.plot([x for x, _ in shown], [y for _, y in shown], color=color, label=name, linestyle='', marker='o',
                       markersize=size, markerfacecolor='white' if hollow else color)
        for text, point in zip(labels, points):
            for at in self.scaled([point]):
                self.axes.annotate(text, at, (6, 4), textcoords='offset points', fontsize=8, color=color,
                                   parse_math=False)

    def range(self, x, low, high, color=0):
        """A bar from the least to the most."""
        self.axes.plot([x, x], [low, high], color=_color(color), linewidth=1.5)

    def note(self, text):
        self.figure.supxlabel(text, x=0.01, ha='left', fontsize=8, color='#555555')

    def svg(self):
        for axis, limits in ((self.axes.xaxis, self.axes.get_xlim()), (self.axes.yaxis, self.axes.get_ylim())):
            if self.logarithmic and limits[1] > 1000 * limits[0] > 0:
                axis.get_major_locator().set_params(subs=(1.0,))
        if self.legend and any(not line.get_label().startswith('_') for line in self.axes.lines):
            self.axes.legend(loc='upper left', bbox_to_anchor=(1, 1), fontsize=8, frameon=False)
        text = io.StringIO()
        self.figure.savefig(text, format='svg', metadata={'Date': None})
        return text.getvalue()
