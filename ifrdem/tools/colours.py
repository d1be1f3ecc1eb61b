"""Colours of M. Okabe and K. Ito, distinct with every kind of colour blindness, for all figures."""

BLUE, VERMILION, GREEN, PURPLE, SKY, ORANGE = "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00"
