"""Open MPI as the tests need it."""

# More ranks than cores, as root in a container, without the one-sided transport that crashes.
MPI_ENVIRONMENT = {
    'OMPI_ALLOW_RUN_AS_ROOT': '1',
    'OMPI_ALLOW_RUN_AS_ROOT_CONFIRM': '1',
    'OMPI_MCA_rmaps_base_oversubscribe': '1',
    'OMPI_MCA_mpi_yield_when_idle': '1',
    'OMPI_MCA_osc': 'sm,pt2pt',
    'OMPI_MCA_btl': 'self,vader,tcp',
}


def under_mpi(ranks):
    """What comes before a command that so many ranks run; nothing for 0."""
    return ['mpirun', '--bind-to', 'none', '-n', str(ranks)] if ranks else []
