/** Who looks: a token where the service has them, kept for this tab unless asked otherwise. */
const KEY = "sparring.token";

function kept(): string | null {
  return sessionStorage.getItem(KEY) ?? localStorage.getItem(KEY);
}

class Session {
  token = $state(kept());
  /** The service has asked for a token. */
  needed = $state(false);

  enter(token: string, remember: boolean) {
    (remember ? localStorage : sessionStorage).setItem(KEY, token);
    this.token = token;
    this.needed = false;
  }

  leave() {
    localStorage.removeItem(KEY);
    sessionStorage.removeItem(KEY);
    this.token = null;
    this.needed = true;
  }
}

export const session = new Session();
