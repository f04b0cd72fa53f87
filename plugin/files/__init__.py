"""What web processes and workers share: the files of jobs and of saved measurements."""
