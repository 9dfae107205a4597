"""Heights in a list: a toy that shows what a new kind of measurement costs."""

from femnl.core.kinds import Contract, Item, KindSpec, label

KIND = KindSpec(
    name="toy",
    stages=("heights",),
    scales=frozenset(("height",)),
    pose="femnl.observe.toy.model:pose",
    figure="femnl.observe.toy.model:figure",
    needs_device=False,
    contract=Contract(
        dims=("point",),
        datasets={
            "height": Item(("point",), "m", required=True),
            "height_sd": Item(("point",), "m", required=True, positive=True),
            "time": label("point", "s"),
        },
    ),
)
