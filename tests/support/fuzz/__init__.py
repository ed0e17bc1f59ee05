# SPDX-License-Identifier: GPL-3.0-or-later
"""Mutated inputs: every one is read as what it means, or refused in one line that names the file.

An area (`areas`) writes inputs, reads them as the project does, and compares what was read with an independent reader.
`cases` runs one of them, `pool` many, in processes with a time limit. Area, seed and number reproduce a case.
"""
