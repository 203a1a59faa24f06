// SPDX-License-Identifier: Apache-2.0
#pragma once

/// Floats must obey IEEE 754 here: every stage finds NaN and infinity with std::isfinite and drops them with a counter, and sums promise
/// the same bits.  With -ffinite-math-only the compiler replaces those tests by `true`, with -fassociative-math it reorders sums
/// (docs/evidence/stability.md, H-71).  Included by sim/base/errors.h, so everywhere.
#if defined(__FAST_MATH__)
#error "Earshot must not be compiled with -ffast-math: tests for NaN would vanish and results would depend on the compiler"
#endif
#if defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__ != 0
#error "Earshot must not be compiled with -ffinite-math-only: tests for NaN would vanish"
#endif
#if defined(__ASSOCIATIVE_MATH__)
#error "Earshot must not be compiled with -fassociative-math: sums would depend on the compiler"
#endif
