"""What the nodes share: parameters, processes, quality of service, exact bytes, discovery."""
