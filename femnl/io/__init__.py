"""What is read and written: measurement files, files of instruments, results."""
