"""Heights: how far down each box of a column stands, so that as many lines as can be run straight.

In each column the boxes keep their order and their distance, and the sum of what their lines bend by is made smallest:
an isotonic regression with absolute errors, solved exactly by pooling neighbours to their weighted median (Robertson,
Wright and Dykstra 1988). Columns take turns.
"""

from collections import defaultdict

from graph.drawing.style import BETWEEN_BOXES, BETWEEN_LINES, ROW

ROUNDS = 6
FAR = 150.0  # px, from where on it stands between two wishes
ANCHOR = 1e-3  # weight of staying where it is, for what no line pulls


def place(columns, hops):
    """Set the `y` of every node, the topmost at 0."""
    pulls = defaultdict(list)  # node: [(own port's y, other node, other port's y, weight)]
    for hop in hops:
        out, into = hop.source.right[hop.output], hop.target.left[hop.input]
        pulls[hop.source].append((out, hop.target, into, hop.weight, False))
        pulls[hop.target].append((into, hop.source, out, hop.weight, True))
    for column in columns:
        stack(column, {node: 0.0 for node in column}, {})
    best, least = None, float("inf")
    for turn in range(ROUNDS):
        for only_left in (True, False, None):
            for column in columns if only_left in (True, None) else reversed(columns):
                settle(column, pulls, only_left)
            bends = sum(hop.weight * abs(bend(hop)) for hop in hops)
            if bends < least - 1e-6:
                best, least = [(node, node.y) for column in columns for node in column], bends
    for node, y in best or ():
        node.y = y
    top = min((node.y for column in columns for node in column), default=0.0)
    for column in columns:
        for node in column:
            node.y = round(node.y - top)


def bend(hop):
    """How far down a hop leads."""
    return hop.target.y + hop.target.left[hop.input] - hop.source.y - hop.source.right[hop.output]


def settle(column, pulls, only_left):
    """Move one column to where its lines want it. only_left : heed those from the left only, from the right only, or,
    with None, all.
    """
    wishes = {}
    for node in column:
        heeded = [pull for pull in pulls[node] if only_left is None or pull[4] == only_left] or pulls[node]
        wishes[node] = [(other.y + port - own, weight) for own, other, port, weight, _ in heeded]
    stack(column, {node: node.y for node in column}, wishes)


def stack(column, present, wishes):
    """Heights in order, at least `gap` apart, nearest to what is wished."""
    pools, offset, above = [], 0.0, None  # a pool: [its wishes less their offsets, how many nodes, where it stands]
    offsets = []
    for node in column:
        if above is not None:
            offset += above.height + gap(above, node)
        offsets.append(offset)
        own = [(y - offset, weight) for y, weight in wishes.get(node, ())] or [(present[node] - offset, ANCHOR)]
        pools.append([own, 1, median(own)])
        while len(pools) > 1 and pools[-2][2] > pools[-1][2]:
            more, count, _ = pools.pop()
            pools[-1][0] = pools[-1][0] + more
            pools[-1][1] += count
            pools[-1][2] = median(pools[-1][0])
        above = node
    index = 0
    for _, count, y in pools:
        for node in column[index : index + count]:
            node.y = y + offsets[index]
            index += 1


def gap(upper, lower):
    """Return the vertical distance between two neighbours of a column."""
    if upper.side and lower.side:
        return ROW
    return (
        BETWEEN_LINES
        if upper.passes and lower.passes
        else BETWEEN_BOXES * (0.75 if upper.passes or lower.passes else 1.0)
    )


def median(wishes):
    """The weighted median; between two, the upper one where they are near, so that one line runs straight, else half
    way.
    """
    wishes = sorted(wishes)
    half, passed = sum(weight for _, weight in wishes) / 2.0, 0.0
    for index, (y, weight) in enumerate(wishes):
        passed += weight
        if passed > half:
            return y
        if passed == half:
            following = wishes[index + 1][0]
            return y if following - y < FAR else round((y + following) / 2.0)
    return wishes[-1][0]
