"""Work in other processes of this machine: how they are started, talked to and ended, and memory shared with them."""
