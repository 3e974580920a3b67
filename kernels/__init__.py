"""All device code: Warp arrays in, Warp arrays out. Knows no class of ``mmocap_warp``.

May import: no other room.
"""
