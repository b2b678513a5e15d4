"""How the service is: status, log, systemd."""
