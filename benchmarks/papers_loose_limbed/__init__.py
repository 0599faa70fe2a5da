"""Reproduction of loose-limbed people: tracking, first frames, part detectors, messages, assembly."""
