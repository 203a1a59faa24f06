// SPDX-License-Identifier: Apache-2.0
// Of this target only the precompiled headers are used.
