"""A pool of worker processes and the memory that they share; knows nothing of what they work on.

`pool.worker_pool` is the interface; a `job.Job` says what the work is about.
"""
