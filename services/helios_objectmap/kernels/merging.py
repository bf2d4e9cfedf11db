"""Two projections into one view become one, without projecting or sorting anything again."""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from helios_objectmap.kernels.projection import DEPTH
from helios_objectmap.kernels.sorting import tie


@njit(cache=True, nogil=True)
def merged_offsets_kernel(number, offsets, entries, more_offsets, out_offsets):
    """How many entries each tile has: those that keep a number (>= 0), and the others' own."""
    out_offsets[0] = 0
    for t in range(offsets.size - 1):
        n = more_offsets[t + 1] - more_offsets[t]
        for k in range(offsets[t], offsets[t + 1]):
            n += number[entries[k]] >= 0
        out_offsets[t + 1] = out_offsets[t] + n


@njit(parallel=True, cache=True, nogil=True)
def merge_kernel(
    splats, number, offsets, entries, n_kept, more_offsets, more_entries, out_offsets, out_entries
):
    """Merge the lists of each tile, near to far.

    splats: all of the new projection, the kept ones first; number: [old k] their new numbers, -1
    for those that go; the others are numbered from n_kept on.
    """
    words = splats.view(np.uint32)
    for t in prange(offsets.size - 1):
        to = out_offsets[t]
        j, last = more_offsets[t], more_offsets[t + 1]
        for k in range(offsets[t], offsets[t + 1]):
            g = number[entries[k]]
            if g < 0:
                continue
            while j < last and _is_nearer(words, n_kept + more_entries[j], g):
                out_entries[to] = n_kept + more_entries[j]
                to += 1
                j += 1
            out_entries[to] = g
            to += 1
        while j < last:
            out_entries[to] = n_kept + more_entries[j]
            to += 1
            j += 1


@njit(cache=True, nogil=True)
def _is_nearer(words, a, b):
    """Whether splat a comes before splat b; depths are positive, and ordered as their bits are."""
    if words[a, DEPTH] != words[b, DEPTH]:
        return words[a, DEPTH] < words[b, DEPTH]
    return tie(words, a) < tie(words, b)
