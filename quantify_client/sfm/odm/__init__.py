"""What an OpenDroneMap output holds, and where."""
