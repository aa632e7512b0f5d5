#pragma once

#include "lumo/support/postgres.hpp"
#include "temporary_folder.hpp"

#include <fcntl.h>
#include <pwd.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

/// A PostgreSQL server of the test's own: in a temporary folder, as a user of its own where the test runs as root,
/// which the server refuses, and on a Unix socket there.
class PostgresServer {
 public:
  /// Why there can be none; empty: there can.
  static std::string missing() {
    if (programs().empty()) return "PostgreSQL is not installed (package postgresql-15)";
    if (geteuid() == 0 && !user()) return "the tests run as root, and there is no user postgres or nobody";
    return "";
  }

  /// Connections with a password are checked as in a real server: only "lumo", who owns it, may come without.
  PostgresServer() {
    namespace fs = std::filesystem;
    fs::permissions(folder_.path, fs::perms::owner_all | fs::perms::group_exec | fs::perms::others_exec);
    fs::create_directory(folder_.path / "server");
    if (geteuid() == 0) {
      REQUIRE(user());
      REQUIRE(::chown((folder_ / "server").c_str(), user()->pw_uid, user()->pw_gid) == 0);
    }
    REQUIRE(wait_for(launch({programs() + "/initdb", "--pgdata", data(), "--username", "lumo", "--auth", "trust",
                "--no-sync", "--locale", "C", "--encoding", "UTF8"})) == 0);
    std::ofstream(data() + "/pg_hba.conf") << "local all lumo trust\nlocal all all scram-sha-256\n";
    start();
  }
  ~PostgresServer() {
    if (pid_ > 0) stop(SIGQUIT);
  }
  PostgresServer(const PostgresServer&) = delete;
  PostgresServer& operator=(const PostgresServer&) = delete;

  void start() {
    REQUIRE(pid_ <= 0);
    const auto run = [&] {
      // A process that is killed leaves what it wrote to the system: only a power failure needs fsync.
      return launch({programs() + "/postgres", "-D", data(), "-k", data(), "-c", "listen_addresses=", "-c", "fsync=off",
          "-c", "max_connections=200", "-c", "log_min_messages=panic"});
    };
    pid_ = run();
    for (int k = 0; k < 600; ++k) {
      if (::waitpid(pid_, nullptr, WNOHANG) == pid_) pid_ = run();  // one that was killed had not quite ended
      if (carried_out("SELECT 1")) return;
      ::usleep(50'000);
    }
    FAIL("PostgreSQL does not start");
  }
  /// SIGQUIT ends it at once, SIGKILL as a crash does.
  void stop(int signal) {
    ::kill(pid_, signal);
    wait_for(pid_);
    pid_ = 0;
  }

  /// Of a store in a schema; `more`: further parameters.
  std::string address(const std::string& schema = "lumo", const std::string& who = "lumo",
      const std::string& database = "postgres", const std::string& more = "") const {
    return "postgresql://" + who + "@/" + database + "?host=" + data() + "&schema=" + schema + more;
  }
  /// Carries out a statement as the owner.
  void sql(const std::string& text) const { REQUIRE(carried_out(text)); }
  std::string data() const { return folder_ / "server/data"; }
  const TemporaryFolder& folder() const { return folder_; }

 private:
  static std::string programs() {
    for (const char* folder : {"/usr/lib/postgresql/15/bin", "/usr/lib/postgresql/16/bin", "/usr/lib/postgresql/17/bin",
             "/usr/pgsql/bin", "/usr/local/pgsql/bin", "/usr/bin"})
      if (std::filesystem::exists(std::string(folder) + "/initdb")) return folder;
    return "";
  }
  static const passwd* user() {
    const passwd* const own = getpwnam("postgres");
    return own ? own : getpwnam("nobody");
  }
  /// Starts a program, silent, as the server's user; it ends with the test.
  static pid_t launch(const std::vector<std::string>& words) {
    const pid_t pid = ::fork();
    if (pid != 0) return pid;
    std::vector<char*> arguments;
    for (const std::string& word : words) arguments.push_back(const_cast<char*>(word.c_str()));
    arguments.push_back(nullptr);
    const int nowhere = ::open("/dev/null", O_WRONLY);
    if (::dup2(nowhere, STDOUT_FILENO) < 0 || ::dup2(nowhere, STDERR_FILENO) < 0) _exit(1);
    if (geteuid() == 0 && (setgid(user()->pw_gid) != 0 || setuid(user()->pw_uid) != 0)) _exit(1);
    if (::chdir("/") != 0 || ::prctl(PR_SET_PDEATHSIG, SIGQUIT) != 0) _exit(1);
    ::execv(arguments[0], arguments.data());
    _exit(127);
  }
  static int wait_for(pid_t pid) {
    int status = 0;
    ::waitpid(pid, &status, 0);
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  }

  bool carried_out(const std::string& text) const {
    const std::unique_ptr<PGconn, decltype(&PQfinish)> session(
        PQconnectdb(("host=" + data() + " user=lumo dbname=postgres").c_str()), PQfinish);
    PQsetNoticeProcessor(
        session.get(), [](void*, const char*) {}, nullptr);
    const std::unique_ptr<PGresult, decltype(&PQclear)> result(PQexec(session.get(), text.c_str()), PQclear);
    const auto status = PQresultStatus(result.get());
    return status == PGRES_COMMAND_OK || status == PGRES_TUPLES_OK;
  }

  TemporaryFolder folder_;
  pid_t pid_ = 0;
};
