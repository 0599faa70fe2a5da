"""Trackers: their contract, their declaration (`Spec`) and shared code. Each tracker has a folder."""
