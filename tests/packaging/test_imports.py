"""No module imports itself by way of others, also not for type checking only."""

from graphlib import TopologicalSorter

import grimp


def test_no_circle() -> None:
    graph = grimp.build_graph("nearfar", cache_dir=None)
    imported = {each: graph.find_modules_directly_imported_by(each) for each in graph.modules}
    order = list(TopologicalSorter(imported).static_order())  # A circle raises CycleError.
    assert len(order) > 150
    assert order.index("nearfar.arrays") < order.index("nearfar.localizer")
