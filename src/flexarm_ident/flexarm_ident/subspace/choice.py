"""Which estimator do the data ask for? What `method="auto"` does.

Three questions are asked in this order, and the first yes decides:

1. Does noise reach the input, as the record says itself (`IoData.closed_loop`)? PBSID-opt.
2. Do later inputs know of the outputs' innovation (`feedback.reaches_inputs`)? PBSID-opt.
3. Is the outputs' noise coloured (`whiteness.whiteness_test`)? ORSE with past instruments.

Otherwise ORSE without instruments, which is the cheapest and as accurate on white noise. Both ORSE
take the later inputs for known when they look at the outputs; PBSID-opt looks at the past only, so
that neither feedback nor what friction does to the rig is mistaken for the rig.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from flexarm_ident.subspace.feedback import reaches_inputs
from flexarm_ident.subspace.gram import block_gram
from flexarm_ident.subspace.orse import innovation_scaled, past_instruments
from flexarm_ident.subspace.pbsid import predictor_space
from flexarm_ident.subspace.request_check import shifts
from flexarm_ident.subspace.whiteness import whiteness_test

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_ident.records.source import Source
    from flexarm_ident.subspace.gram import BlockGram
    from flexarm_ident.subspace.orse import Subspace


class Selection(NamedTuple):
    """The chosen estimator with its result, which follows from the same products.

    Attributes
    ----------
    method : {'orse', 'orse_iv', 'pbsid'}
        Estimator.
    reason : str
        What was chosen and why, in one sentence.
    gram : BlockGram
        Products of the data.
    space : Subspace
        Models of every order by that estimator.
    """

    method: str
    reason: str
    gram: BlockGram
    space: Subspace


def select_method(
    records: Sequence[Source],
    block_rows: int,
    *,
    closed_loop: bool,
    order: int | None = None,
    feedthrough: bool = False,
) -> Selection:
    """Choose the estimator.

    Parameters
    ----------
    records : sequence of Source
        Records of one rig, in memory or read in chunks.
    block_rows : int
        Block rows of the Hankel matrices, q of (2-18).
    closed_loop : bool
        Whether a record is known to be made in closed loop.
    order : int, optional
        Number of states; half of `block_rows` when it is not known yet.
    feedthrough : bool
        Whether D will be fitted.

    Returns
    -------
    Selection
        Choice, reason and what was computed for it.
    """
    if closed_loop:
        return _past_only(
            records, block_rows, "a record was made in closed loop", feedthrough=feedthrough
        )
    gram = block_gram(records, block_rows)
    if reaches_inputs(gram):
        because = "later inputs know of the outputs' noise, by feedback or seemingly by friction"
        return _past_only(records, block_rows, because, feedthrough=feedthrough)
    space = innovation_scaled(gram)
    noise = whiteness_test(space, gram.columns, order or block_rows // 2)
    figures = f"spread {noise.spread:.3g} of its power over directions, limit {noise.limit:.3g}"
    if not noise.white:
        gram = block_gram(records, shifts("orse_iv", block_rows))
        reason = f"orse_iv was chosen: the outputs' noise is coloured: {figures}"
        return Selection("orse_iv", reason, gram, past_instruments(gram))
    reason = f"orse was chosen: no feedback, and the outputs' noise passes for white: {figures}"
    return Selection("orse", reason, gram, space)


def _past_only(
    records: Sequence[Source], block_rows: int, because: str, *, feedthrough: bool
) -> Selection:
    gram = block_gram(records, shifts("pbsid", block_rows))
    reason = f"pbsid was chosen: {because}"
    return Selection("pbsid", reason, gram, predictor_space(gram, feedthrough=feedthrough))
