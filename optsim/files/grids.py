"""Wavelengths of well-known sets, in nm, for files that do not say theirs."""

TSA_TENTHS_NM = (
    453.3, 457.6, 462.1, 466.8, 471.6, 476.5, 481.6, 486.9, 492.4, 498.0, 503.9, 509.9, 516.2, 522.7,
    529.5, 536.5, 543.8, 551.4, 558.6, 567.5, 575.3, 584.3, 594.4, 604.2, 614.4, 625.1, 636.3, 648.1,
)  # fmt: skip
"""The 28 bands of the TSA-Net set-up (Meng, Ma, Yuan, ECCV 2020) as some of its users list them."""

TSA_HALVES_NM = (
    453.5, 457.5, 462.0, 466.0, 471.5, 476.5, 481.5, 487.0, 492.5, 498.0, 504.0, 510.0, 516.0, 522.5,
    529.5, 536.5, 544.0, 551.5, 558.5, 567.5, 575.5, 584.5, 594.5, 604.0, 614.5, 625.0, 636.5, 648.0,
)  # fmt: skip
"""The same bands rounded to half nanometres, as the plotting code of later solvers (MST and its heirs) has them."""
