/* The main function: runs the command that the command line names, with MPI where it needs it, and returns its exit
 * code. */
#include <errno.h>
#include <math.h>
#include <mpi.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include "coordinator/bake/prepare/prepare.h"
#include "coordinator/mpi/waiting.h"
#include "coordinator/mpi/watchdog.h"
#include "coordinator/mpi/agree.h"
#include "coordinator/cli/commands.h"
#include "coordinator/cli/help_json.h"
#include "coordinator/cli/studies.h"
#include "coordinator/cli/help_text.h"
#include "coordinator/files/json.h"
#include "coordinator/files/standard_output.h"
#include "coordinator/job/conditions.h"
#include "coordinator/job/options.h"
#include "coordinator/run/process.h"
#include "coordinator/cli/same_job.h"
#include "coordinator/export/child.h"
#include "coordinator/files/foreign_json.h"
#include "coordinator/field/group_fields.h"
#include "coordinator/import/child.h"
#include "coordinator/job/changes.h"
#include "coordinator/output/read/reader.h"
#include "coordinator/run/threads.h"
#include "coordinator/output/manifest.h"

/* Returns a number that the launcher has set in the environment, which is known before MPI starts. Launchers are Open
 * MPI's mpirun, PMIx (srun --mpi=pmix) and Slurm. Returns `fallback` if none has set it. */
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

/* Whether a launcher has started this process as one of several. Not so for single processes in a batch script. */
static bool is_launched(void)
{
    return launcher("OMPI_COMM_WORLD_SIZE", NULL, NULL, 1) > 1 ||
           (getenv("PMIX_RANK") != NULL && launcher(NULL, NULL, "SLURM_NTASKS", 1) > 1);
}

static bool has_argument(int argc, char **argv, const char *text)
{
    for (int i = 1; i < argc && strcmp(argv[i], "--") != 0; i++)
        if (strcmp(argv[i], text) == 0)
            return true;
    return false;
}

/* Prints the error. Call on one rank, before MPI_Finalize: the launcher kills the other ranks once the first one has
 * exited with a failure. */
static void print_error(int status, const struct kiln_error *error, bool json)
{
    const char *sentence =
        error->message[0] != '\0' ? error->message : "failed without saying why; this is a bug of kiln";
    const bool stopped = status == KILN_STOPPED; /* a requested stop is no error */
    (void)fprintf(stderr, "kiln: %s%s\n", stopped ? "" : "error: ", sentence);
    if (!json)
        return; /* stderr needs no flush */
    (void)kiln_json_print(json_pack("{s:s, s:i, s:o}", "status", stopped ? "stopped" : "error", "code", status,
                                    "message", kiln_json_string(sentence)),
                          NULL);
    (void)fflush(stdout);
}

/* Checks the path of the scene early, so that a misspelt path is reported at once. The importer checks it again. */
static int check_scene(const struct kiln_job *job, struct kiln_error *error)
{
    struct stat status;
    if (job->scene.file == NULL)
        return KILN_OK;
    if (stat(job->scene.file, &status) != 0)
        return kiln_fail_errno(error, errno == ENOTDIR ? KILN_NO_INPUT : 0, "cannot read scene %.500s",
                               job->scene.file);
    if (S_ISDIR(status.st_mode))
        return kiln_fail(error, KILN_BAD_INPUT, "scene %.500s is a folder; name the .glb, .gltf or .obj file in it",
                         job->scene.file);
    if (!S_ISREG(status.st_mode))
        return kiln_fail(error, KILN_BAD_INPUT, "scene %.500s is not a regular file", job->scene.file);
    if (access(job->scene.file, R_OK) != 0)
        return kiln_fail_errno(error, 0, "cannot read scene %.500s", job->scene.file);
    return KILN_OK;
}

/* Whether a scene may stand in the place of the folder of a bake: path-traced views take both. */
static bool may_be_scene(const struct kiln_job *job) { return kiln_view_is_traced(job->view.method); }

static int check_folder(const struct kiln_job *job, const char *folder, struct kiln_error *error)
{
    struct stat status;
    if (stat(folder, &status) != 0)
        return kiln_fail_errno(error, errno == ENOTDIR ? KILN_NO_INPUT : 0, "cannot read %s %.500s",
                               may_be_scene(job) ? "scene or folder of a bake" : "folder", folder);
    if (!S_ISDIR(status.st_mode))
        return kiln_fail(error, KILN_NO_INPUT, "%.500s is a file; name the folder that a bake was written to", folder);
    if (kiln_folder_of_bake(folder))
        return KILN_OK;
    return kiln_fail(
        error, KILN_NO_INPUT,
        "%.500s is not the folder of a bake: it has no run.json, scene.kscene or checkpoint; name the folder "
        "that kiln bake -o wrote to",
        folder);
}

/* Whether the command's argument is a scene file, given in the place of a bake's folder. Only path-traced views take
 * one. */
static bool takes_scene(const struct kiln_job *job)
{
    struct stat status;
    return may_be_scene(job) && stat(job->arguments[0], &status) == 0 && !S_ISDIR(status.st_mode);
}

static int prepare(struct kiln_job **job, int argc, char **argv, const struct kiln_command *command,
                   struct kiln_error *error)
{
    int status;
    KILN_TRY(kiln_job_parse(job, argc, argv, error));
    KILN_TRY(kiln_group_fields_make(*job, error));
    if (command->folder && takes_scene(*job))
        (*job)->scene.file = (*job)->arguments[0];
    else if (command->folder)
        KILN_TRY(check_folder(*job, (*job)->arguments[0], error));
    KILN_TRY(check_scene(*job, error));
    KILN_TRY(kiln_job_parts_check(*job, error));
    KILN_TRY(kiln_process_need_stack(error));
end:
    return status;
}

static int run(const struct kiln_command *command, struct kiln_job *job, struct kiln_error *error)
{
    switch ((enum kiln_command_bit)command->bit) {
    case KILN_FOR_BAKE:
        return kiln_command_bake(job, error);
    case KILN_FOR_RELIGHT:
        return kiln_command_relight(job, error);
    case KILN_FOR_PLAN:
        return kiln_command_plan(job, error);
    case KILN_FOR_MIX:
        return kiln_command_mix(job, error);
    case KILN_FOR_IMPORT:
        return kiln_command_import(job, error);
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

/* Prints one line for this rank in a single write, so that lines of different ranks do not mix. */
static void print_usage(int rank)
{
    struct rusage usage;
    char line[160];
    if (getrusage(RUSAGE_SELF, &usage) != 0)
        return;
    const double user = (double)usage.ru_utime.tv_sec + 1e-6 * (double)usage.ru_utime.tv_usec;
    const double system = (double)usage.ru_stime.tv_sec + 1e-6 * (double)usage.ru_stime.tv_usec;
    (void)snprintf(line, sizeof line,
                   "kiln: rank %d: %.2f s of processor time, %.2f s of it in the system, %.1f MiB at most\n", rank,
                   user + system, system, (double)usage.ru_maxrss / 1024);
    (void)fputs(line, stderr);
}

/* Prints the present names of options that were given by former names, and the options that have no effect. Call on one
 * rank. */
static void note_options(const struct kiln_job *job)
{
    if (job == NULL || job->quiet)
        return;
    kiln_job_print_renamed(job, stderr);
    kiln_job_print_idle(job, stderr);
}

/* Flushes stdout. Output that cannot be written is a failure, even if the command has succeeded. */
static int flush_output(int status, struct kiln_error *error)
{
    const int flushed = kiln_stdout_flush(status == KILN_OK ? error : NULL);
    return status != KILN_OK ? status : flushed;
}

/* Runs a command without MPI. *json: whether a failure has still to be printed on stdout as JSON. */
static int run_alone(int argc, char **argv, const struct kiln_command *command, bool *json, struct kiln_error *error)
{
    struct kiln_job *job = NULL;
    int status = prepare(&job, argc, argv, command, error);
    note_options(job);
    if (status == KILN_OK)
        status = flush_output(run(command, job, error), error);
    if (job != NULL && job->verbose)
        print_usage(0);
    *json = *json && (job == NULL || !job->answered);
    kiln_job_destroy(&job);
    return status;
}

/* State for the handlers of unexpected exits. Some libraries end the process themselves: OpenMP calls exit(1) if it
 * gets no thread, and C++ libraries throw exceptions. The state is global, since the handlers get no argument. */
static struct {
    volatile sig_atomic_t at_work;
    char who[96];
} departure;

static void leave(const char *what)
{
    char text[600];
    (void)snprintf(text, sizeof text,
                   "kiln: error: %sa library ended the process: %.300s; more memory, or more threads (ulimit -u), or "
                   "fewer --threads may help\n",
                   departure.who, what);
    (void)!write(STDERR_FILENO, text, strlen(text));
    _exit(KILN_SYSTEM);
}

static void say_departure(void)
{
    if (departure.at_work != 0)
        leave("its message is above");
}

static void watch_departure(bool many, int rank)
{
    char host[64] = "";
    (void)gethostname(host, sizeof host - 1);
    if (many)
        (void)snprintf(departure.who, sizeof departure.who, "rank %d on %s: ", rank, host);
    departure.at_work = 1;
    (void)atexit(say_departure);
    kiln_on_uncaught(leave);
}

enum { START_SECONDS = 30 };                 /* least time that the ranks have to start, s */
enum { MPI_THREADS = 3, OTHER_THREADS = 6 }; /* threads of Open MPI; with those of the watchdog and the status file */

/* MPI error handler: reports failures of MPI like all others. */
static void report_mpi_failure(MPI_Comm *communicator, int *code, ...)
{
    struct kiln_waiting waiting;
    struct kiln_error error;
    char text[MPI_MAX_ERROR_STRING] = "";
    int length, kind = MPI_ERR_OTHER;
    (void)communicator;
    (void)PMPI_Error_class(*code, &kind);
    (void)PMPI_Error_string(*code, text, &length);
    kiln_waiting_look(&waiting);
    const int status = kind == MPI_ERR_NO_MEM ? KILN_SYSTEM : KILN_RANK_LOST;
    (void)kiln_fail(&error, status, "%s failed: %s", waiting.call != NULL ? waiting.call : "MPI", text);
    kiln_end_all_ranks(status, &error);
}

static void catch_mpi_errors(void)
{
    MPI_Errhandler handler;
    if (MPI_Comm_create_errhandler(report_mpi_failure, &handler) != MPI_SUCCESS)
        return;
    (void)MPI_Comm_set_errhandler(MPI_COMM_WORLD, handler);
    (void)MPI_Comm_set_errhandler(MPI_COMM_SELF, handler);
    (void)MPI_Errhandler_free(&handler);
}

/* Starts MPI. `many`: there are several ranks, and all of them must have created the watchdog within `seconds` (0: no
 * limit). */
static int start_mpi(bool many, int *rank, double seconds, struct kiln_error *error)
{
    int provided = MPI_THREAD_SINGLE;
    /* this component needs no file for shared file pointers; others leave one behind when the process is killed */
    (void)setenv("OMPI_MCA_sharedfp", "individual", 0);
    /* Open MPI asks hwloc about the machine. hwloc then loads whole drivers (OpenCL, OpenGL, CUDA) to list devices that
     * kiln does not need: 0.3 s where they are installed. A single process needs no network either. Reading the
     * registers of each PCI device takes a quarter of MPI's start in a virtual machine. */
    (void)setenv("HWLOC_COMPONENTS",
                 many ? "-opencl,-cuda,-nvml,-rsmi,-levelzero,-gl"
                      : "-opencl,-cuda,-nvml,-rsmi,-levelzero,-gl,-linux:pci,-linux:io",
                 0);
    if (many) {
        kiln_watchdog_start(*rank, seconds);
    } else { /* a single process needs no network (UCX, libfabric): looking for one takes 0.2 s */
        (void)setenv("OMPI_MCA_pml", "ob1", 0);
        /* it needs no daemon of Open MPI */
        (void)setenv("OMPI_MCA_ess_singleton_isolated", "1", 0);
        /* and no session folder in TMPDIR: processes that start at the same time collide there, and a killed one leaves
         * it behind */
        (void)setenv("OMPI_MCA_orte_create_session_dirs", "0", 0);
    }
    kiln_waiting_follow();
    /* several ranks: the watchdog's thread calls MPI too */
    if (MPI_Init_thread(NULL, NULL, many ? MPI_THREAD_MULTIPLE : MPI_THREAD_FUNNELED, &provided) != MPI_SUCCESS)
        return kiln_fail(error, KILN_SITE, "MPI does not start; check the installation of Open MPI");
    catch_mpi_errors();
    (void)MPI_Comm_rank(MPI_COMM_WORLD, rank);
    if (provided < MPI_THREAD_FUNNELED)
        return kiln_fail(error, KILN_SITE, "this MPI library does not support threads (MPI_THREAD_FUNNELED is needed)");
    return KILN_OK;
}

static double start_seconds(double limit) { return limit > 0.0 ? fmax(2.0 * limit, START_SECONDS) : 0.0; }

/* Collective. Runs the command under a watchdog. Bakes create a watchdog of their own, which knows their phases. */
static int run_watched(const struct kiln_command *command, struct kiln_job *job, struct kiln_error *error)
{
    struct kiln_watchdog *watchdog = NULL;
    if ((command->bit & (KILN_FOR_BAKE | KILN_FOR_RELIGHT)) != 0)
        return run(command, job, error);
    int rank;
    (void)MPI_Comm_rank(MPI_COMM_WORLD, &rank);
    int status = kiln_watchdog_create(&watchdog, MPI_COMM_WORLD, job->checkpoints.watchdog,
                                      kiln_faults_halt(&job->faults, (uint32_t)rank), error);
    if (status == KILN_OK) {
        kiln_watchdog_phase(watchdog, command->name);
        status = run(command, job, error);
    }
    kiln_watchdog_destroy(&watchdog);
    return status;
}

/* Checks that enough threads can be started. If threads for MPI are missing, this rank cannot tell the others, and
 * exits. */
static int check_threads(const struct kiln_job *job, bool many, struct kiln_error *error)
{
    const int ranks = (int)launcher("OMPI_COMM_WORLD_LOCAL_SIZE", NULL, NULL, 1);
    if (many && kiln_threads_check(MPI_THREADS, error) != KILN_OK) {
        (void)fprintf(stderr, "kiln: error: %s%s\n", departure.who, error->message);
        _exit(KILN_SYSTEM);
    }
    return kiln_threads_check(
        (job->machine.threads != 0 ? job->machine.threads : kiln_own_cores(ranks)) + OTHER_THREADS, error);
}

/* Runs a command with MPI. A single rank reports a wrong command line without starting MPI; of several ranks each tells
 * the others whether its command line was right. */
static int run_with_mpi(int argc, char **argv, const struct kiln_command *command, bool many, int rank,
                        struct kiln_error *error)
{
    struct kiln_job *job = NULL;
    bool started = false;
    int status = prepare(&job, argc, argv, command, error);
    if (rank == 0)
        note_options(job);
    if (status == KILN_OK)
        status = check_threads(job, many, error);
    if (status == KILN_OK || many) {
        const double limit = job != NULL ? job->checkpoints.watchdog : 4.0 * START_SECONDS;
        struct kiln_error mpi = {{0}};
        const int start = start_mpi(many, &rank, start_seconds(limit), &mpi);
        started = start != KILN_SITE;
        if (start != KILN_OK) {
            status = start;
            *error = mpi;
        }
    }
    if (started) {
        status = kiln_agree(MPI_COMM_WORLD, status, error);
        if (status == KILN_OK)
            status = kiln_same_job(MPI_COMM_WORLD, command->name, job, error);
        if (status == KILN_OK)
            status = kiln_agree(MPI_COMM_WORLD, flush_output(run_watched(command, job, error), error), error);
    }
    if (job != NULL && job->verbose)
        print_usage(rank);
    if (status != KILN_OK && rank == 0)
        print_error(status, error, has_argument(argc, argv, "--json"));
    if (started)
        (void)MPI_Finalize();
    kiln_job_destroy(&job);
    return status;
}

/* Compares this rank's command with those of other ranks, if several ranks were started for a command of a single
 * process. The command needs no MPI, but ranks with another command would wait for this one. */
static int meet_others(char **argv, int *rank, struct kiln_error *error)
{
    struct kiln_error own = {{0}};
    int status;
    KILN_TRY(start_mpi(true, rank, start_seconds(2.0 * START_SECONDS), &own));
    KILN_TRY(kiln_agree(MPI_COMM_WORLD, KILN_OK, &own));
    KILN_TRY(kiln_same_job(MPI_COMM_WORLD, argv[1], NULL, &own));
end:
    if (status != KILN_SITE)
        (void)MPI_Finalize();
    (void)alarm(0);
    if (status != KILN_OK)
        *error = own;
    return status;
}

/* Whether the command line asks for help or the version. */
static bool asks_for_help(int argc, char **argv)
{
    return argc < 2 || strcmp(argv[1], "help") == 0 || has_argument(argc, argv, "--help") ||
           has_argument(argc, argv, "-h") || has_argument(argc, argv, "--version");
}

/* Prints a manual page or completion script, made from the table of options. Returns false if the command line asks for
 * neither. */
static bool answer_made(int argc, char **argv, int rank, int *status, struct kiln_error *error)
{
    const bool man = argc == 2 && strcmp(argv[1], "--man") == 0;
    const bool completion = argc > 1 && strcmp(argv[1], "--completion") == 0;
    *status = KILN_OK;
    if (!man && !completion)
        return false;
    if (completion && (argc != 3 || strcmp(argv[2], "bash") != 0))
        *status = kiln_fail(error, KILN_USAGE, "--completion is there for bash alone: kiln --completion bash");
    else if (completion && rank == 0)
        kiln_completion_print(stdout);
    else if (rank == 0)
        kiln_man_print(stdout);
    if (*status == KILN_OK)
        *status = flush_output(KILN_OK, error);
    return true;
}

/* Whether all options are to be shown: kiln bake --help all, kiln help bake all. */
static bool asks_for_all(int argc, char **argv)
{
    const bool first = argc > 2 && (strcmp(argv[1], "help") == 0 || strcmp(argv[1], "--help") == 0);
    bool all = first && strcmp(argv[argc - 1], "all") == 0;
    for (int i = 1; i + 1 < argc; i++)
        all =
            all || ((strcmp(argv[i], "--help") == 0 || strcmp(argv[i], "-h") == 0) && strcmp(argv[i + 1], "all") == 0);
    return all;
}

/* Prints help or the version, which need no job. Returns false if the command line asks for neither. */
static bool answer_help(int argc, char **argv, int rank, int *status, struct kiln_error *error)
{
    if (!asks_for_help(argc, argv))
        return false;
    const bool version = argc > 1 && strcmp(argv[1], "help") != 0 && !has_argument(argc, argv, "--help") &&
                         !has_argument(argc, argv, "-h");
    *status = KILN_OK;
    if (rank != 0)
        return true;
    if (version) {
        (void)printf("kiln %s\n", KILN_VERSION);
        *status = flush_output(KILN_OK, error);
        return true;
    }
    const bool all = asks_for_all(argc, argv);
    const char *name = NULL;
    for (int i = 1; i < argc && name == NULL; i++)
        if (argv[i][0] != '-' && (i > 1 || strcmp(argv[i], "help") != 0) && (!all || strcmp(argv[i], "all") != 0))
            name = argv[i];
    const struct kiln_command *command = name != NULL ? kiln_command_find(name) : NULL;
    if (name != NULL && command == NULL) {
        *status = kiln_command_unknown(name, error);
        return true;
    }
    if (has_argument(argc, argv, "--json")) {
        *status = kiln_help_json(command, error);
        return true;
    }
    /* without any argument the help is shown too, but the status is that of an error */
    kiln_help(argc < 2 ? stderr : stdout, command, all);
    *status = argc < 2 ? kiln_fail(error, KILN_USAGE, "no command given") : flush_output(KILN_OK, error);
    return true;
}

/* The last value that the command line gives an option; "": none. */
static const char *value_of(int argc, char **argv, const char *option)
{
    const size_t length = strlen(option);
    const char *value = "";
    for (int i = 1; i < argc; i++) {
        if (strncmp(argv[i], option, length) != 0)
            continue;
        if (argv[i][length] == '=')
            value = argv[i] + length + 1;
        else if (argv[i][length] == '\0' && i + 1 < argc)
            value = argv[i + 1];
    }
    return value;
}

/* Whether the command line asks for a traced view, which several ranks may compute, or for a view of links, for which a
 * bake must be prepared. */
static bool view_needs_mpi(int argc, char **argv)
{
    const char *const *names = kiln_option_find_for("method", KILN_FOR_VIEW)->choices,
                      *method = value_of(argc, argv, "--method");
    for (int m = 0; names[m] != NULL; m++)
        if (strcmp(method, names[m]) == 0 && kiln_view_is_traced(m))
            return true;
    return strcmp(value_of(argc, argv, "--show"), "links") == 0;
}

/* Whether the command saves its work when a signal asks it to end, and can resume. */
static bool saves_when_asked(const char *name) { return strcmp(name, "bake") == 0 || strcmp(name, "relight") == 0; }

static int run_command_line(int argc, char **argv)
{
    struct kiln_error error = {{0}};
    int status = KILN_OK;
    bool json = has_argument(argc, argv, "--json");
    const bool many = launcher("OMPI_COMM_WORLD_SIZE", NULL, "SLURM_NTASKS", 1) > 1;
    int rank = (int)launcher("OMPI_COMM_WORLD_RANK", "PMIX_RANK", "SLURM_PROCID", 0);
    if (kiln_study_is_asked_for(argc, argv) && rank != 0)
        return KILN_OK; /* rank 0 runs the study */
    if (kiln_study_is_asked_for(argc, argv)) {
        status = kiln_study_start(argc, argv, &error);
        print_error(status, &error, json);
        return status;
    }
    watch_departure(many, rank);
    const struct kiln_command *command = argc > 1 ? kiln_command_find(argv[1]) : NULL;
    if (command != NULL && !saves_when_asked(argv[1]) && kiln_option_find_for("output", command->bit) != NULL)
        kiln_process_end_cleanly(rank == 0, json);
    /* a bench that starts mpirun must not start MPI itself */
    const bool starts_mpi = command != NULL && command->bit == KILN_FOR_BENCH && has_argument(argc, argv, "scaling");
    const bool help = asks_for_help(argc, argv); /* rank 0 answers at once, whatever the other ranks do */
    const bool view = command != NULL && command->bit == KILN_FOR_VIEW && view_needs_mpi(argc, argv);
    const bool needs_mpi = command != NULL && (command->mpi || view) && !starts_mpi && !help;
    if (is_launched() && !needs_mpi && !starts_mpi && !help)
        status = meet_others(argv, &rank, &error);
    if (status == KILN_OK && !answer_help(argc, argv, rank, &status, &error) &&
        !answer_made(argc, argv, rank, &status, &error)) {
        if (needs_mpi)
            return run_with_mpi(argc, argv, command, many, rank, &error);
        if (rank != 0)
            return KILN_OK; /* rank 0 runs the command */
        if (command != NULL)
            status = run_alone(argc, argv, command, &json, &error);
        else
            status = kiln_command_unknown(argv[1], &error);
    }
    if (status != KILN_OK && rank == 0)
        print_error(status, &error, json);
    return status;
}

int kiln_main(int argc, char **argv)
{
    kiln_process_begin();
    if (argc > 1 && saves_when_asked(argv[1]))
        kiln_process_catch();
    if (argc > 1 && strcmp(argv[1], "import-child") == 0)
        return kiln_import_child(argc, argv);
    if (argc > 1 && strcmp(argv[1], "export-child") == 0)
        return kiln_export_child(argc, argv);
    if (argc > 1 && strcmp(argv[1], "read-child") == 0)
        return kiln_reader_child(argc, argv);
    if (argc > 1 && strcmp(argv[1], KILN_JSON_CHILD) == 0)
        return kiln_foreign_json_child(argc, argv, NULL);
    if (argc > 1 && strcmp(argv[1], KILN_YAML_CHILD) == 0)
        return kiln_foreign_json_child(argc, argv, kiln_changes_parse);
    const int status = run_command_line(argc, argv);
    departure.at_work = 0;
    return status;
}
