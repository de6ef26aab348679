"""Training of SiamAPN++: pictures to pairs, pairs to labels and losses, stages to weights with a card.

The way of the data: `sources` (who has pictures with boxes) -> `pairs` (which two, and where the target is) ->
`augment` (how the crops look) -> `targets`, `losses` -> `loop` (stages, checkpoints) -> `export` (weights, card).
"""
