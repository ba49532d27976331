"""Pages on this machine: one hardened server on the loopback interface, for baked folders and live sessions."""
