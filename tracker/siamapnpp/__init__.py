"""SiamAPN++ (Cao et al., IROS 2021, arXiv 2106.08816): network, crop, decoding and the tracker around them."""
