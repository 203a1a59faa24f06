# SPDX-License-Identifier: Apache-2.0
"""Far-field speech recognition: trained in simulated rooms, tested in measured ones.

`python -m earshot_asr table` trains a small recognizer on speech in several kinds of rooms and tests it in measured rooms.
`python -m earshot_asr rooms` plays speech through measured and simulated responses of one room to recognizers as they are.
`python -m earshot_asr dereverb` trains a mask network on `dataset convolve`, `direction` one for angles on `dataset scenes`.
"""
