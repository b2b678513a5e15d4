// Asks for the token of a page that is open beyond its host.

const form = document.querySelector("form"), said = document.querySelector(".said");

form.addEventListener("submit", async (event) => {
  event.preventDefault();
  const body = JSON.stringify({ token: form.elements.token.value.trim() });
  const headers = { "Content-Type": "application/json" };
  const answer = await fetch("/login", { method: "POST", headers, body }).catch(() => null);
  if (answer?.ok) location.replace("/");
  else said.textContent = explain(answer);
});

function explain(answer) {
  if (!answer) return "The page's server does not answer.";
  if (answer.status === 429) return `Too many tries: wait ${answer.headers.get("Retry-After") ?? "a few"} s.`;
  return "This is not the token.";
}
