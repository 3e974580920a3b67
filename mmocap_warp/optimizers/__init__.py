"""Population optimizers on the device, a file each; they minimise any batched cost and know no body."""
