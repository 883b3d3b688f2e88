/* From the command line to a command and back to an exit code. */
#include <errno.h>
#include <mpi.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include "coordinator/cli/agree.h"
#include "coordinator/cli/commands.h"
#include "coordinator/cli/json.h"
#include "coordinator/cli/options.h"
#include "coordinator/output/manifest.h"

/* What the launcher says before MPI is started: Open MPI's mpirun, PMIx (srun --mpi=pmix), Slurm. Alone: rank 0 of 1. */
static long launcher(const char *open_mpi, const char *pmix, const char *slurm, long fallback)
{
    const char *const names[] = {open_mpi, pmix, slurm};
    for (size_t i = 0; i < sizeof names / sizeof names[0]; i++) {
        const char *text = names[i] != NULL ? getenv(names[i]) : NULL;
        char *end = NULL;
        const long value = text != NULL ? strtol(text, &end, 10) : 0;
        if (text != NULL && end != text && *end == '\0' && value >= 0)
            return value;
    }
    return fallback;
}

static bool has_argument(int argc, char **argv, const char *text)
{
    for (int i = 1; i < argc && strcmp(argv[i], "--") != 0; i++)
        if (strcmp(argv[i], text) == 0)
            return true;
    return false;
}

/* To be called on one rank, before MPI ends: the launcher kills all that still run when the first rank has left with a failure. */
static void print_error(int status, const struct kiln_error *error, bool json)
{
    const char *sentence = error->message[0] != '\0' ? error->message : "failed without saying why; this is a bug of kiln";
    const bool stopped = status == KILN_STOPPED; /* as it was asked to: no error */
    (void)fprintf(stderr, "kiln: %s%s\n", stopped ? "" : "error: ", sentence);
    if (!json)
        return; /* stderr is not buffered */
    (void)kiln_json_print(json_pack("{s:s, s:i, s:o}", "status", stopped ? "stopped" : "error", "code", status, "message", kiln_json_string(sentence)), NULL);
    (void)fflush(stdout);
}

/* Looked at before anything is started, so that a misspelt path is answered at once. The reader looks again. */
static int check_scene(const struct kiln_job *job, struct kiln_error *error)
{
    struct stat status;
    if (job->scene == NULL)
        return KILN_OK;
    if (stat(job->scene, &status) != 0)
        return kiln_fail_errno(error, errno == ENOTDIR ? KILN_NO_INPUT : 0, "cannot read scene %.500s", job->scene);
    if (S_ISDIR(status.st_mode))
        return kiln_fail(error, KILN_BAD_INPUT, "scene %.500s is a folder; name the .glb, .gltf or .obj file in it", job->scene);
    if (!S_ISREG(status.st_mode))
        return kiln_fail(error, KILN_BAD_INPUT, "scene %.500s is not a regular file", job->scene);
    if (access(job->scene, R_OK) != 0)
        return kiln_fail_errno(error, 0, "cannot read scene %.500s", job->scene);
    return KILN_OK;
}

static int check_folder(const char *folder, struct kiln_error *error)
{
    struct stat status;
    if (stat(folder, &status) != 0)
        return kiln_fail_errno(error, errno == ENOTDIR ? KILN_NO_INPUT : 0, "cannot read folder %.500s", folder);
    if (!S_ISDIR(status.st_mode))
        return kiln_fail(error, KILN_NO_INPUT, "%.500s is a file; name the folder that a bake was written to", folder);
    if (kiln_folder_of_bake(folder))
        return KILN_OK;
    return kiln_fail(error, KILN_NO_INPUT, "%.500s is not the folder of a bake: it has no run.json, scene.kscene or checkpoint; name the folder "
                     "that kiln bake -o wrote to", folder);
}

static int prepare(struct kiln_job **job, int argc, char **argv, const struct kiln_command *command, struct kiln_error *error)
{
    int status = kiln_job_parse(job, argc, argv, error);
    if (status == KILN_OK && command->folder)
        status = check_folder((*job)->arguments[0], error);
    return status != KILN_OK ? status : check_scene(*job, error);
}

static int run(const struct kiln_command *command, struct kiln_job *job, struct kiln_error *error)
{
    switch ((enum kiln_command_bit)command->bit) {
    case KILN_FOR_BAKE:
        return kiln_command_bake(job, error);
    case KILN_FOR_PLAN:
        return kiln_command_plan(job, error);
    case KILN_FOR_INFO:
        return kiln_command_info(job, error);
    case KILN_FOR_CHECK:
        return kiln_command_check(job, error);
    case KILN_FOR_VIEW:
        return kiln_command_view(job, error);
    case KILN_FOR_COMPARE:
        return kiln_command_compare(job, error);
    case KILN_FOR_PROBE:
        return kiln_command_probe(job, error);
    case KILN_FOR_GENERATE:
        return kiln_command_generate(job, error);
    case KILN_FOR_REPORT:
        return kiln_command_report(job, error);
    case KILN_FOR_BENCH:
        return kiln_command_bench(job, error);
    case KILN_FOR_SUBMIT:
        return kiln_command_submit(job, error);
    case KILN_FOR_STATUS:
        return kiln_command_status(job, error);
    case KILN_FOR_STOP:
        return kiln_command_stop(job, error);
    case KILN_FOR_VERIFY:
        return kiln_command_verify(job, error);
    case KILN_FOR_EXPORT:
        return kiln_command_export(job, error);
    case KILN_FOR_ALL:
        break;
    }
    return kiln_fail(error, KILN_BUG, "the command %s is in the table of commands and does nothing", command->name);
}

/* One line a rank; a line is one write, so that the ranks' lines do not mix. */
static void print_usage(int rank)
{
    struct rusage usage;
    char line[160];
    if (getrusage(RUSAGE_SELF, &usage) != 0)
        return;
    const double user = (double)usage.ru_utime.tv_sec + 1e-6 * (double)usage.ru_utime.tv_usec;
    const double system = (double)usage.ru_stime.tv_sec + 1e-6 * (double)usage.ru_stime.tv_usec;
    (void)snprintf(line, sizeof line, "kiln: rank %d: %.2f s of processor time, %.2f s of it in the system, %.1f MiB at most\n", rank,
                   user + system, system, (double)usage.ru_maxrss / 1024);
    (void)fputs(line, stderr);
}

/* Output that could not be written is a failure, however well the command went. */
static int flush_output(int status, struct kiln_error *error)
{
    if (fflush(stdout) == 0 && ferror(stdout) == 0)
        return status;
    return status != KILN_OK ? status : kiln_fail_errno(error, KILN_IO, "cannot write to stdout");
}

/* *json: whether a failure has still to be said on stdout. */
static int run_alone(int argc, char **argv, const struct kiln_command *command, bool *json, struct kiln_error *error)
{
    struct kiln_job *job = NULL;
    int status = prepare(&job, argc, argv, command, error);
    if (status == KILN_OK)
        status = flush_output(run(command, job, error), error);
    if (job != NULL && job->verbose)
        print_usage(0);
    *json = *json && (job == NULL || !job->answered);
    kiln_job_destroy(&job);
    return status;
}

/* Under a launcher MPI starts before the job is read, so that ranks of different minds can tell each other. Alone a wrong
 * command line is answered without it. */
static int run_with_mpi(int argc, char **argv, const struct kiln_command *command, bool many, int rank, struct kiln_error *error)
{
    struct kiln_job *job = NULL;
    int status = many ? KILN_OK : prepare(&job, argc, argv, command, error), provided = MPI_THREAD_SINGLE;
    bool started = false;
    if (status != KILN_OK)
        goto end;
    if (!many) { /* alone: Open MPI need not start a daemon of its own for one process, nor share file pointers through its folder */
        (void)setenv("OMPI_MCA_ess_singleton_isolated", "1", 0);
        /* nor make a folder in TMPDIR: processes that start at the same time get in each other's way there, and a killed one leaves it */
        (void)setenv("OMPI_MCA_orte_create_session_dirs", "0", 0);
        (void)setenv("OMPI_MCA_sharedfp", "individual", 0); /* leaves no name with a process number when killed */
    }
    /* many: for the watchdog's thread */
    if (MPI_Init_thread(NULL, NULL, many ? MPI_THREAD_MULTIPLE : MPI_THREAD_FUNNELED, &provided) != MPI_SUCCESS) {
        status = kiln_fail(error, KILN_SITE, "MPI does not start; check the installation of Open MPI");
        goto end;
    }
    started = true;
    (void)MPI_Comm_rank(MPI_COMM_WORLD, &rank);
    if (provided < MPI_THREAD_FUNNELED)
        status = kiln_fail(error, KILN_SITE, "this MPI library does not work beside threads (MPI_THREAD_FUNNELED is needed)");
    else if (many)
        status = prepare(&job, argc, argv, command, error);
    status = kiln_agree(MPI_COMM_WORLD, status, error);
    if (status == KILN_OK)
        status = kiln_agree(MPI_COMM_WORLD, flush_output(run(command, job, error), error), error);
end:
    if (job != NULL && job->verbose)
        print_usage(rank);
    if (status != KILN_OK && rank == 0)
        print_error(status, error, has_argument(argc, argv, "--json"));
    if (started)
        (void)MPI_Finalize();
    kiln_job_destroy(&job);
    return status;
}

/* Help and version need no job. Returns false when the command line asks for neither. */
static bool answer_help(int argc, char **argv, int rank, int *status, struct kiln_error *error)
{
    const bool help = argc < 2 || strcmp(argv[1], "help") == 0 || has_argument(argc, argv, "--help") || has_argument(argc, argv, "-h");
    const bool version = !help && has_argument(argc, argv, "--version");
    if (!help && !version)
        return false;
    *status = KILN_OK;
    if (rank != 0)
        return true;
    if (version) {
        (void)printf("kiln %s\n", KILN_VERSION);
        *status = flush_output(KILN_OK, error);
        return true;
    }
    const char *name = NULL;
    for (int i = 1; i < argc && name == NULL; i++)
        if (argv[i][0] != '-' && (i > 1 || strcmp(argv[i], "help") != 0))
            name = argv[i];
    const struct kiln_command *command = name != NULL ? kiln_command_find(name) : NULL;
    if (name != NULL && command == NULL) {
        *status = kiln_command_unknown(name, error);
        return true;
    }
    /* Without any argument the screen is shown too, but nothing was done. */
    kiln_help(argc < 2 ? stderr : stdout, command);
    *status = argc < 2 ? kiln_fail(error, KILN_USAGE, "no command given") : flush_output(KILN_OK, error);
    return true;
}

int kiln_main(int argc, char **argv)
{
    if (argc > 1 && strcmp(argv[1], "import-child") == 0)
        return kiln_import_child(argc, argv);
    if (argc > 1 && strcmp(argv[1], "export-child") == 0)
        return kiln_export_child(argc, argv);
    struct kiln_error error = {{0}};
    int status = KILN_OK;
    bool json = has_argument(argc, argv, "--json");
    const bool many = launcher("OMPI_COMM_WORLD_SIZE", NULL, "SLURM_NTASKS", 1) > 1;
    const int rank = (int)launcher("OMPI_COMM_WORLD_RANK", "PMIX_RANK", "SLURM_PROCID", 0);
    if (!answer_help(argc, argv, rank, &status, &error)) {
        const struct kiln_command *command = kiln_command_find(argv[1]);
        /* A bench that starts mpirun must not be in an MPI job of its own. */
        const bool starts_mpi = command != NULL && command->bit == KILN_FOR_BENCH && has_argument(argc, argv, "scaling");
        if (command != NULL && command->mpi && !starts_mpi)
            return run_with_mpi(argc, argv, command, many, rank, &error);
        if (rank != 0)
            return KILN_OK; /* one process does it */
        if (command != NULL)
            status = run_alone(argc, argv, command, &json, &error);
        else
            status = kiln_command_unknown(argv[1], &error);
    }
    if (status != KILN_OK && rank == 0)
        print_error(status, &error, json);
    return status;
}
